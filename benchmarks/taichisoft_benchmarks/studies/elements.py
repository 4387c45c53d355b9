"""What each kind of element makes of bodies whose deformation is known, at Poisson's ratios up to that of silicone.

    python -m taichisoft_benchmarks.studies.elements --output docs/elements.md

fills what stands between `<!-- elements -->` and `<!-- end -->` in the page. It takes some ten minutes.

    TAICHISOFT_THREADS=1 python -m taichisoft_benchmarks.studies.elements --plot docs/elements.svg

draws the bend of the tutorial's finger over nodes and over the processor's time for a step, on one thread.
"""

import argparse
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.errors import TaichisoftError
from taichisoft.meshes.files import write_volume_mesh
from taichisoft.meshes.volume_mesh import VolumeMesh
from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.studies.element_costs import draw_costs, measure_costs
from taichisoft_benchmarks.studies.finger_at_rest import bend
from taichisoft_benchmarks.studies.round_meshes import bar, hollow_sphere, rounded, tube

ELEMENTS = ("linear", "smoothed", "quadratic")
POISSON_RATIOS = (0.3, 0.45, 0.49, 0.499)
MARKED = re.compile(r"(<!-- elements -->\n).*?(<!-- end -->)", re.DOTALL)

YOUNG_MODULUS = 100.0
"""Of spheres and tubes [kPa]; the pressure in them is 1e-4 of it."""
INNER, OUTER = 10.0, 20.0
"""Their radii [mm]."""

BEAM = (100.0, 30.0, 30.0)
"""The measured beam [mm], clamped at one end."""
BEAM_YOUNG_MODULUS, BEAM_POISSON_RATIO, BEAM_DENSITY = 255.0, 0.499, 1.07e-6
BEAM_LOADS = {"own weight": 0.0, "52 g": 510.0, "101 g": 1000.6}
"""Forces at the upper edge of its tip [mN]."""
BEAM_MEASURED = {"own weight": "6.5", "52 g": "17.0", "101 g": "25.4 to 26.2"}
"""Displacement of its tip [mm]: Dragon Skin 10 (srl-ethz/diffPD_sim2real)."""
BEAM_CELLS = {
    "linear": ((20, 6, 6),),
    "smoothed": ((10, 3, 3), (13, 4, 4), (20, 6, 6)),
    "quadratic": ((7, 2, 2), (10, 3, 3)),
}
"""Cells of its meshes: a quadratic element on some has nearly the nodes of a smoothed one on twice as many each way."""

STEP, DAMPING = 10.0, 5.0
"""Time step and Rayleigh's factor of the stiffness [s]: each step goes two thirds of the way to rest."""
RAMP = 10
"""Number of steps in which loads rise."""
WEAK = 1e-6
"""Stiffness of springs that pull with a constant force [mN/mm]."""
STILL = 1e-4
"""Largest motion of a node in a step, relative to that of the whole way, at which a body counts as resting."""
MOST_STEPS = 400


def at_rest(
    mesh: VolumeMesh,
    pressure: float = 0.0,
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    dead_load: Callable[[np.ndarray], np.ndarray] | None = None,
    small: bool = False,
    **body: Any,
) -> np.ndarray:
    """Displacements of the nodes of a body under loads, and its rest positions.

    Args:
        mesh: its mesh, with the group "cavity" if there is a pressure.
        pressure: in the cavity [kPa].
        gravity: [mm/s^2].
        dead_load: gives forces on the nodes [mN] from their rest positions, both (node_count, 3). They are springs so
            weak and long that nothing changes them.
        small: whether its strains are small, so that one step of Newton's leads to rest; nothing need hold it then.
        body: keys of the soft body.

    Returns:
        Displacements and rest positions, shape (2, node_count, 3).

    Raises:
        TaichisoftError: it does not come to rest.
    """
    from taichisoft.building.simulation import Simulation
    from taichisoft.control.control import Control
    from taichisoft.scenes.file import scene_from_dict

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "body.msh"
        write_volume_mesh(mesh, path)
        table = {"mesh": str(path), "density": 1e-6, "rayleigh_stiffness": DAMPING, **body}
        time = {"step": STEP, "dynamics": "first order" if small else "second order"}
        if pressure:
            table["cavities"] = {"cavity": {"group": "cavity"}}
        simulation = Simulation(scene_from_dict({"time": time, "soft_bodies": {"body": table}}, "at rest"))
    rest = simulation.model.rest_position
    anchored = simulation.model.anchored_nodes
    pulled = np.zeros((len(anchored), 3))
    if dead_load is not None:
        pulled = dead_load(rest)[anchored] / WEAK
    before, ramp = rest, 1 if small else RAMP
    for index in range(1, MOST_STEPS + 1):
        share = min(1.0, index / ramp)
        simulation.step(
            Control(
                pressure={"body.cavity": share * pressure} if pressure else {},
                gravity=share * np.array(gravity),
                anchor_positions={"body": rest[anchored] + share * pulled} if dead_load is not None else {},
            )
        )
        after = simulation.state.position
        if index > ramp and np.abs(after - before).max() < STILL * np.abs(after - rest).max():
            return np.array([after - rest, rest])
        before = after
    raise TaichisoftError(f"{mesh.source}: still moves after {MOST_STEPS} steps")


def sphere_error(element: str, poisson_ratio: float, mesh: VolumeMesh) -> float:
    """Relative error of the growth of the inner radius of a sphere under pressure (Lame's solution)."""
    pressure = 1e-4 * YOUNG_MODULUS
    motion, rest = at_rest(
        mesh,
        pressure,
        small=True,
        young_modulus=YOUNG_MODULUS,
        poisson_ratio=poisson_ratio,
        element=element,
    )
    radius = np.linalg.norm(rest, axis=1)
    inside = np.isclose(radius, INNER, rtol=1e-6)
    growth = (motion[inside] * rest[inside]).sum(axis=1).mean() / INNER
    shape = (1 - 2 * poisson_ratio) * INNER + (1 + poisson_ratio) * OUTER**3 / (2 * INNER**2)
    exact = pressure / YOUNG_MODULUS * INNER**3 / (OUTER**3 - INNER**3) * shape
    return float(growth / exact - 1)


def tube_error(element: str, poisson_ratio: float, mesh: VolumeMesh) -> float:
    """The same of a tube between lids that keep their distance (plane strain)."""
    pressure, length = 1e-4 * YOUNG_MODULUS, mesh.nodes[:, 2].max()
    far = 2 * OUTER
    lids = [{"box": [[-far, -far, z], [far, far, z]], "directions": ["z"]} for z in (0.0, float(length))]
    motion, rest = at_rest(
        mesh,
        pressure,
        small=True,
        young_modulus=YOUNG_MODULUS,
        poisson_ratio=poisson_ratio,
        element=element,
        anchors=lids,
    )
    radius = np.linalg.norm(rest[:, :2], axis=1)
    inside = np.isclose(radius, INNER, rtol=1e-6)
    growth = (motion[inside, :2] * rest[inside, :2]).sum(axis=1).mean() / INNER
    shape = (1 - 2 * poisson_ratio) * INNER + OUTER**2 / INNER
    exact = (1 + poisson_ratio) * pressure / YOUNG_MODULUS * INNER**2 / (OUTER**2 - INNER**2) * shape
    return float(growth / exact - 1)


def beam_sag(element: str, cells: tuple[int, int, int], load: float, law: str = "neo-hookean") -> float:
    """Displacement of the beam's tip [mm] under its own weight and a force down at its upper edge [mN]."""
    length, width, height = BEAM
    upper_edge = [[length, 0.0, height], [length, width, height]]
    anchors: list[dict[str, Any]] = [{"box": [[0.0, 0.0, 0.0], [0.0, width, height]]}]
    anchors.append({"box": upper_edge, "directions": ["z"], "stiffness": WEAK})

    def dead_load(rest: np.ndarray) -> np.ndarray:
        """The ends of the edge carry half of what its other nodes do."""
        on_edge = np.isclose(rest[:, 0], length) & np.isclose(rest[:, 2], height)
        share = np.where(on_edge, np.where(np.isclose(np.abs(rest[:, 1] - width / 2), width / 2), 0.5, 1.0), 0.0)
        return np.column_stack([np.zeros((len(rest), 2)), -load * share / share.sum()])

    motion, rest = at_rest(
        bar(cells, BEAM),
        gravity=(0.0, 0.0, -9810.0),
        dead_load=dead_load,
        density=BEAM_DENSITY,
        young_modulus=BEAM_YOUNG_MODULUS,
        poisson_ratio=BEAM_POISSON_RATIO,
        element=element,
        law=law,
        anchors=anchors,
    )
    return float(np.linalg.norm(motion[np.isclose(rest[:, 0], length)].mean(axis=0)))


def beam_frequency(element: str, cells: tuple[int, int, int], step: float = 0.001, duration: float = 1.0) -> float:
    """First frequency of the beam [Hz], released from its moulded shape, from the crossings of its mean."""
    from taichisoft.building.simulation import Simulation
    from taichisoft.scenes.file import scene_from_dict

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "beam.msh"
        write_volume_mesh(bar(cells, BEAM), path)
        body = {
            "mesh": str(path),
            "density": BEAM_DENSITY,
            "young_modulus": BEAM_YOUNG_MODULUS,
            "poisson_ratio": BEAM_POISSON_RATIO,
            "element": element,
            "anchors": [{"box": [[0.0, 0.0, 0.0], [0.0, *BEAM[1:]]]}],
        }
        scene = {"gravity": (0.0, 0.0, -9810.0), "time": {"step": step}, "soft_bodies": {"beam": body}}
        simulation = Simulation(scene_from_dict(scene, "swinging beam"))
    tip = np.isclose(simulation.model.rest_position[:, 0], BEAM[0])
    heights = []
    for _ in range(round(duration / step)):
        simulation.step()
        heights.append(simulation.state.position[tip, 2].mean())
    around = np.array(heights) - np.mean(heights[-round(0.3 / step) :])
    crossings = np.flatnonzero((around[:-1] < 0) & (around[1:] >= 0))
    exact = crossings + around[crossings] / (around[crossings] - around[crossings + 1])
    return float((len(exact) - 1) / ((exact[-1] - exact[0]) * step))


def page_section() -> Iterator[str]:
    """The study as Markdown, paragraph by paragraph."""
    yield "\n".join(_finger_table())
    sphere, round_tube = hollow_sphere(INNER, OUTER, 4, 3), tube(INNER, OUTER, 20.0, 24, 3, 4)
    for what, coarse, axes, fine, error in (
        ("sphere", sphere, 3, hollow_sphere(INNER, OUTER, 6, 6), sphere_error),
        ("tube", round_tube, 2, tube(INNER, OUTER, 20.0, 40, 5, 9), tube_error),
    ):
        lines = [f"| {what} | corners | " + " | ".join(f"{nu:g}" for nu in POISSON_RATIOS) + " |"]
        lines.append("|---|---|" + "---|" * len(POISSON_RATIOS))
        rows = [("linear", "linear", fine), ("smoothed", "smoothed", fine), ("quadratic", "quadratic", coarse)]
        rows.append(("quadratic, curved sides", "quadratic", rounded(coarse, axes)))
        for name, element, mesh in rows:
            errors = [error(element, nu, mesh) for nu in POISSON_RATIOS]
            corners = len(np.unique(mesh.elements[:, :4]))
            lines.append(f"| {name} | {corners} | " + " | ".join(f"{one:+.1%}" for one in errors) + " |")
            print(lines[-1], flush=True)
        yield "\n".join(lines)
    yield "\n".join(_beam_table())


def _finger_table() -> Iterator[str]:
    yield "| finger at 30 kPa [mm] | nodes | 0.3 | 0.49 | 0.499 |"
    yield "|---|---|---|---|---|"
    for mesh in ("tutorial-coarse", "tutorial-medium"):
        for element in ELEMENTS:
            bends = []
            for poisson_ratio in (0.3, 0.49, 0.499):
                nodes, _, one = bend(mesh, damping=8.0, element=element, poisson_ratio=poisson_ratio)
                bends.append(f"{one:.1f}")
            yield f"| {element} | {nodes} | {' | '.join(bends)} |"
            print(mesh, element, *bends, flush=True)


def _beam_table() -> Iterator[str]:
    yield "| beam, tip [mm] | nodes | " + " | ".join(BEAM_LOADS) + " | first frequency [Hz] |"
    yield "|---|---|" + "---|" * (len(BEAM_LOADS) + 1)
    for element, meshes in BEAM_CELLS.items():
        for cells in meshes:
            nodes = np.prod(np.array(cells) * (2 if element == "quadratic" else 1) + 1)
            sags = [f"{beam_sag(element, cells, load):.1f}" for load in BEAM_LOADS.values()]
            frequency = f"{beam_frequency(element, cells):.2f}"
            yield f"| {element} | {nodes} | {' | '.join(sags)} | {frequency} |"
            print(cells, element, *sags, frequency, flush=True)
    yield "| measured | | " + " | ".join(BEAM_MEASURED.values()) + " | 7.7 |"


def main() -> None:
    """Measure, and fill the page in place, or draw."""
    parser = argparse.ArgumentParser(prog="python -m taichisoft_benchmarks.studies.elements")
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("-o", "--output", type=Path, metavar="PAGE.md", help="page to fill")
    where.add_argument("--plot", type=Path, metavar="FILE.svg", help="draw bend and time per step instead")
    arguments = parser.parse_args()
    try:
        if arguments.plot:
            draw_costs(measure_costs(), arguments.plot)
            return
        page = arguments.output.read_text(encoding="utf-8")
        if not MARKED.search(page):
            raise BenchmarkError(f"{arguments.output}: has no line <!-- elements -->")
        section = "\n\n".join(page_section())
        filled = MARKED.sub(lambda match: f"{match[1]}{section}\n{match[2]}", page)
        arguments.output.write_text(filled, encoding="utf-8")
    except (TaichisoftError, OSError) as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
