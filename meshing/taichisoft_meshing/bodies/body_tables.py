"""The tables that `taichisoft mesh info` prints of a body from CAD."""

import numpy as np
from rich.console import Group

from taichisoft_meshing.bodies.cad_body import CadBody
from taichisoft_meshing.quality.quality_tables import aligned_table


def body_tables(body: CadBody) -> Group:
    """The solids of a body from CAD, its faces with the numbers that geometry files name, its cavities and openings."""

    def place(point: np.ndarray) -> str:
        return ", ".join(f"{value:.4g}" for value in np.round(point, 3) + 0.0)

    solids = [(f"{one.number}", one.name, f"{one.volume:.1f}") for one in body.solids]
    of_void = {face: f"cavity {number}" for number, void in enumerate(body.voids, 1) for face in void}
    of_void |= {face: f"opening {number}" for number, one in enumerate(body.openings, 1) for face in one.faces}
    of_void |= dict.fromkeys(body.flat_end, "base, unless another is named")
    faces = [
        (
            f"{face.number}",
            " | ".join(map(str, face.solids)),
            f"{face.area:.1f}",
            place(face.centre),
            "curved" if face.normal is None else place(face.normal),
            of_void.get(face.number, ""),
        )
        for face in body.faces
    ]
    air = [(f"cavity {number}", f"{volume:.1f}", "closed") for number, volume in enumerate(body.void_volumes, 1)]
    air += [(f"opening {number}", f"{one.volume:.1f}", str(one)) for number, one in enumerate(body.openings, 1)]
    return Group(
        aligned_table(body.path.name, (">solid", "name", ">volume [mm³]"), solids),
        aligned_table("", (">face", "solids", ">area [mm²]", "centre [mm]", "normal", ""), faces),
        *([aligned_table("", ("air", ">volume [mm³]", ""), air)] * bool(air)),
    )
