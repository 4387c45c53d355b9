"""Errors of each kind of element for bodies whose deformation is known, at Poisson's ratios up to that of silicone.

    python -m taichisoft_benchmarks.studies.element_errors --output docs/elements.md

fills the section "elements" of the page, in some ten minutes.

    TAICHISOFT_THREADS=1 python -m taichisoft_benchmarks.studies.element_errors --plot docs/elements.svg

draws the bend of the tutorial's finger over nodes and over the processor's time for a step, on one thread.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from taichisoft.mesh import VolumeMesh
from taichisoft_benchmarks.marked_page import PageOption, fill_section, heading, row
from taichisoft_benchmarks.program import run_program
from taichisoft_benchmarks.regular_meshes import bar, hollow_sphere, rounded, tube
from taichisoft_benchmarks.studies.element_costs import ELEMENTS, draw_costs, measure_costs
from taichisoft_benchmarks.studies.finger_at_rest import bend
from taichisoft_benchmarks.studies.one_body import WEAK, at_rest, simulation_of

if TYPE_CHECKING:  # a simulation brings Taichi
    from taichisoft.contact import Model
    from taichisoft.running import Simulation

POISSON_RATIOS = (0.3, 0.45, 0.49, 0.499)

YOUNG_MODULUS = 100.0
"""Of spheres and tubes [kPa]; the pressure in them is 1e-4 of it."""
INNER, OUTER = 10.0, 20.0
"""Their radii [mm]."""

BEAM = (100.0, 30.0, 30.0)
"""The measured beam [mm], clamped at one end."""
BEAM_BODY: dict[str, Any] = {"young_modulus": 255.0, "poisson_ratio": 0.499, "density": 1.07e-6}
BEAM_CLAMP = {"box": [[0.0, 0.0, 0.0], [0.0, *BEAM[1:]]]}
GRAVITY = (0.0, 0.0, -9810.0)
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


def sphere_error(element: str, poisson_ratio: float, mesh: VolumeMesh) -> float:
    """Relative error of the growth of the inner radius of a sphere under pressure (Lame's solution)."""
    shape = (1 - 2 * poisson_ratio) * INNER + (1 + poisson_ratio) * OUTER**3 / (2 * INNER**2)
    exact = INNER**3 / (OUTER**3 - INNER**3) * shape
    return _growth(mesh, 3, element=element, poisson_ratio=poisson_ratio) / exact - 1


def tube_error(element: str, poisson_ratio: float, mesh: VolumeMesh) -> float:
    """The same of a tube between lids that keep their distance (plane strain)."""
    far = 2 * OUTER
    length = float(mesh.nodes[:, 2].max())
    lids = [{"box": [[-far, -far, z], [far, far, z]], "directions": ["z"]} for z in (0.0, length)]
    shape = (1 - 2 * poisson_ratio) * INNER + OUTER**2 / INNER
    exact = (1 + poisson_ratio) * INNER**2 / (OUTER**2 - INNER**2) * shape
    return _growth(mesh, 2, element=element, poisson_ratio=poisson_ratio, anchors=lids) / exact - 1


def _growth(mesh: VolumeMesh, axes: int, **body: Any) -> float:
    """Growth of the inner radius [mm] under a pressure, over that pressure's share of Young's modulus."""
    pressure = 1e-4 * YOUNG_MODULUS
    motion, rest = at_rest(mesh, pressure, small=True, young_modulus=YOUNG_MODULUS, **body)[:, :, :axes]
    inside = np.isclose(np.linalg.norm(rest, axis=1), INNER, rtol=1e-6)
    return float((motion[inside] * rest[inside]).sum(axis=1).mean() / INNER / (pressure / YOUNG_MODULUS))


def beam_sag(element: str, cells: tuple[int, int, int], load: float, **body: Any) -> float:
    """Displacement of the beam's tip [mm] under its own weight and a force down at its upper edge [mN].

    Args:
        element: kind of element.
        cells: of the mesh.
        load: [mN].
        body: keys of the soft body instead of those of `BEAM_BODY`.
    """
    motion, rest = beam_at_rest(element, cells, load, **body)
    return float(np.linalg.norm(motion[np.isclose(rest[:, 0], BEAM[0])].mean(axis=0)))


def edge_shares(rest: np.ndarray) -> np.ndarray:
    """Shares of the nodes in a load on the upper edge of the beam's tip, whose ends carry half as much as its others.

    Shape (node_count,), from rest positions [mm], shape (node_count, 3).
    """
    length, width, height = BEAM
    on_edge = np.isclose(rest[:, 0], length) & np.isclose(rest[:, 2], height)
    share = np.where(on_edge, np.where(np.isclose(np.abs(rest[:, 1] - width / 2), width / 2), 0.5, 1.0), 0.0)
    return np.asarray(share / share.sum())


def beam_at_rest(element: str, cells: tuple[int, int, int], load: float, **body: Any) -> np.ndarray:
    """Displacements and rest positions of the beam's nodes [mm], shape (2, node_count, 3); arguments of `beam_sag`."""
    length, width, height = BEAM
    upper_edge = [[length, 0.0, height], [length, width, height]]
    edge = {"box": upper_edge, "directions": ["z"], "stiffness": WEAK}

    def dead_load(model: "Model") -> np.ndarray:
        shares = edge_shares(model.rest_position)
        return np.column_stack([np.zeros((len(shares), 2)), -load * shares])

    keys = {"element": element, "anchors": [BEAM_CLAMP, edge], **(body or {"law": "neo-hookean", **BEAM_BODY})}
    return at_rest(bar(cells, BEAM), gravity=GRAVITY, dead_load=dead_load, ramp=4, **keys)


def beam(cells: tuple[int, int, int], time: dict[str, Any], **body: Any) -> "Simulation":
    """The clamped beam in its moulded shape, under its own weight."""
    simulation: Simulation = simulation_of(
        bar(cells, BEAM), time, GRAVITY, **{"anchors": [BEAM_CLAMP], **BEAM_BODY, **body}
    )
    return simulation


def beam_frequency(element: str, cells: tuple[int, int, int], step: float = 0.001, duration: float = 1.0) -> float:
    """First frequency of the beam [Hz], released from its moulded shape, from the crossings of its mean."""
    simulation = beam(cells, {"step": step}, element=element)
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
    """The study as Markdown, line by line."""
    yield from _finger_table()
    sphere, round_tube = hollow_sphere(INNER, OUTER, 4, 3), tube(INNER, OUTER, 20.0, 24, 3, 4)
    fine_sphere, fine_tube = hollow_sphere(INNER, OUTER, 6, 6), tube(INNER, OUTER, 20.0, 40, 5, 9)
    yield from _round_table("sphere", 3, sphere, fine_sphere, sphere_error)
    yield from _round_table("tube", 2, round_tube, fine_tube, tube_error)
    yield from _beam_table()


def _finger_table() -> Iterator[str]:
    yield heading(["finger at 30 kPa [mm]", "nodes", "0.3", "0.49", "0.499"])
    for mesh in ("tutorial-coarse", "tutorial-medium"):
        for element in ELEMENTS:
            found = [bend(mesh, damping=8.0, element=element, poisson_ratio=ratio) for ratio in (0.3, 0.49, 0.499)]
            yield row([element, found[0][0], *(f"{way:.1f}" for _, _, way in found)])


def _round_table(
    what: str, axes: int, coarse: VolumeMesh, fine: VolumeMesh, error: Callable[[str, float, VolumeMesh], float]
) -> Iterator[str]:
    yield "\n" + heading([what, "corners", *(f"{ratio:g}" for ratio in POISSON_RATIOS)])
    for name, element, mesh in (
        ("linear", "linear", fine),
        ("smoothed", "smoothed", fine),
        ("quadratic", "quadratic", coarse),
        ("quadratic, curved sides", "quadratic", rounded(coarse, axes)),
    ):
        errors = [f"{error(element, ratio, mesh):+.1%}" for ratio in POISSON_RATIOS]
        yield row([name, len(np.unique(mesh.elements[:, :4])), *errors])


def _beam_table() -> Iterator[str]:
    yield "\n" + heading(["beam, tip [mm]", "nodes", *BEAM_LOADS, "first frequency [Hz]"])
    for element, meshes in BEAM_CELLS.items():
        for cells in meshes:
            nodes = np.prod(np.array(cells) * (2 if element == "quadratic" else 1) + 1)
            sags = [f"{beam_sag(element, cells, load):.1f}" for load in BEAM_LOADS.values()]
            yield row([element, nodes, *sags, f"{beam_frequency(element, cells):.2f}"])
    yield row(["measured", "", *BEAM_MEASURED.values(), "7.7"])


def main(
    output: PageOption = None,
    plot: Annotated[Path | None, typer.Option(metavar="FILE.svg", help="Draw bend and time of a step instead.")] = None,
) -> None:
    """Errors of each kind of element for bodies whose deformation is known."""
    if plot:
        draw_costs(measure_costs(), plot)
    else:
        fill_section(output, "elements", page_section())


if __name__ == "__main__":
    run_program(main, "taichisoft_benchmarks.studies.element_errors")
