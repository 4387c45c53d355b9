"""A finger to be made: its solid as STEP and STL, and the mould to cast it in, two halves and a core, as STL.

The halves part in the plane z = 0. Every cut of a finger goes through its whole width, so that nothing is undercut when
they are pulled apart along z. The mould is open at the base, where the silicone is poured in and the core is held.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from taichisoft_meshing.finger.parameters import FingerParameters
from taichisoft_meshing.finger.solid import Solids, finger_cavity, finger_outside
from taichisoft_meshing.gmsh_session import gmsh_session

AROUND = 24
"""Edges around a full turn of a curved face."""
LARGEST_EDGE = 20.0
"""Longest edge of a triangle [mm]."""

Build = Callable[[Any, FingerParameters, float], Solids]


def write_finger(parameters: FingerParameters, folder: Path, name: str, wall: float) -> dict[str, float]:
    """Write NAME.step, NAME.stl, NAME-mould-left.stl, NAME-mould-right.stl and NAME-core.stl.

    Args:
        parameters: dimensions of the finger.
        folder: where the files go; it must exist.
        name: beginning of their names.
        wall: thickness of the mould [mm].

    Returns:
        Volume of each part [mm^3] by its name, as OpenCASCADE measures it.

    Raises:
        MeshError: gmsh cannot be loaded, or OpenCASCADE cannot make a part.
    """
    parts: dict[str, Build] = {
        "": lambda occ, finger, _: occ.cut(finger_outside(occ, finger), finger_cavity(occ, finger))[0],
        "-mould-left": lambda occ, finger, thickness: _half(occ, finger, thickness, -1.0),
        "-mould-right": lambda occ, finger, thickness: _half(occ, finger, thickness, 1.0),
        "-core": lambda occ, finger, _: finger_cavity(occ, finger),
    }
    volumes = {}
    for suffix, build in parts.items():
        with gmsh_session(f"{name}{suffix}") as gmsh:
            build(gmsh.model.occ, parameters, wall)
            gmsh.model.occ.synchronize()
            volumes[f"{name}{suffix}"] = sum(gmsh.model.occ.getMass(*part) for part in gmsh.model.getEntities(3))
            if not suffix:
                with _silence():
                    gmsh.write(str(folder / f"{name}.step"))
            for _, solid in gmsh.model.getEntities(3):  # otherwise voids would be inside out
                gmsh.model.mesh.setOutwardOrientation(solid)
            gmsh.option.setNumber("Mesh.MeshSizeMax", LARGEST_EDGE)
            gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", AROUND)
            gmsh.option.setNumber("Mesh.Binary", 1)
            gmsh.model.mesh.generate(2)
            gmsh.write(str(folder / f"{name}{suffix}.stl"))
    return volumes


@contextmanager
def _silence() -> Iterator[None]:
    """Send what OpenCASCADE prints when it writes STEP to nowhere; gmsh's options do not silence it."""
    before = os.dup(1)
    with Path(os.devnull).open("wb") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        try:
            yield
        finally:
            os.dup2(before, 1)
            os.close(before)


def _half(occ: Any, finger: FingerParameters, wall: float, side: float) -> Solids:
    """The half of the mould at positive or negative z."""
    body = finger.body
    length, height, depth = body.length + wall, body.height + 2.0 * wall, body.width / 2.0 + wall
    block = occ.addBox(-length, -wall, 0.0 if side > 0.0 else -depth, length, height, depth)
    half: Solids
    half, _ = occ.cut([(3, block)], finger_outside(occ, finger))
    return half
