"""Bending, buckling and swinging of bars, and Cook's membrane, by each kind of element, against theory.

    python -m taichisoft_benchmarks.studies.bending --output docs/validation.md

fills what stands between `<!-- bending -->` and `<!-- end -->` in the page. It takes some three minutes.
"""

import argparse
import re
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_bvp
from scipy.optimize import brentq
from scipy.sparse import bsr_array, diags_array
from scipy.sparse.linalg import eigsh

from taichisoft.errors import TaichisoftError
from taichisoft.meshes.files import write_volume_mesh
from taichisoft.meshes.volume_mesh import VolumeMesh
from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.studies.cook_membrane import corner_rise
from taichisoft_benchmarks.studies.round_meshes import bar

MARKED = re.compile(r"(<!-- bending -->\n).*?(<!-- end -->)", re.DOTALL)

LENGTH, HEIGHT = 100.0, 4.0
"""Of the bar [mm]; it is square, and clamped at one end."""
YOUNG_MODULUS, DENSITY = 500.0, 1e-6
STIFFNESS = YOUNG_MODULUS * HEIGHT**4 / 12
"""EI [mN mm^2]; Poisson's ratio is 0, so that sections keep their shape as in the theory of beams."""
CELLS = {"linear": (50, 2, 2), "smoothed": (50, 2, 2), "quadratic": (25, 1, 1)}
"""Of the bar's meshes: quadratic elements have as many nodes as the others."""

COOK_MODULUS, COOK_POISSON, COOK_LOAD = 240.565, 0.4999, 100.0
"""kPa, and mN for each mm of thickness (de Souza Neto et al. 1996, Design of simple low order finite elements)."""

WEAK = 1e-6
"""Stiffness of springs that pull with a constant force [mN/mm]."""
STEP, LINEARISATIONS = 1e3, 200
"""One time step leads to rest: its length [s], and the most linearisations in it."""


def rest(
    mesh: VolumeMesh,
    pulled: tuple[int, float],
    load: np.ndarray,
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    loads: int = 1,
    **body: Any,
) -> tuple[np.ndarray, np.ndarray]:
    """Rest positions and displacements of the nodes under dead loads, each of shape (node_count, 3).

    Args:
        mesh: its mesh.
        pulled: axis, and place on it [mm], of the plane face that the load pulls.
        load: its sum [mN], shape (3,).
        gravity: [mm/s^2].
        loads: number of steps in which loads rise; with one only, all come at once.
        body: keys of the soft body.

    Raises:
        TaichisoftError: it does not come to rest.
    """
    from taichisoft.building.simulation import Simulation
    from taichisoft.control.control import Control
    from taichisoft.scenes.file import scene_from_dict

    axis, place = pulled
    low, high = mesh.nodes.min(axis=0) - 1.0, mesh.nodes.max(axis=0) + 1.0
    low[axis], high[axis] = place - 1e-6, place + 1e-6
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "body.msh"
        write_volume_mesh(mesh, path)
        table = {"mesh": str(path), "density": DENSITY, **body}
        table["anchors"] = [*body["anchors"], {"box": [low.tolist(), high.tolist()], "stiffness": WEAK}]
        time = {"step": STEP, "newton": LINEARISATIONS, "newton_tolerance": 1e-7}
        simulation = Simulation(scene_from_dict({"time": time, "soft_bodies": {"body": table}}, "at rest"))
    model = simulation.model
    anchored = model.anchored_nodes
    pulls = _shares(model.soft_bodies[0].elements, model.rest_position, axis, place)[:, None] * load
    for index in range(1, loads + 1):
        share = index / loads
        held = model.rest_position[anchored] + share * pulls[anchored] / WEAK
        report = simulation.step(Control(gravity=share * np.array(gravity), anchor_positions={"body": held}))
    if not report.converged:
        raise TaichisoftError(f"{mesh.source}: {report.newton_residual:.2g} mm are left of its motion to rest")
    return model.rest_position, simulation.state.position - model.rest_position


def _shares(elements: np.ndarray, nodes: np.ndarray, axis: int, place: float) -> np.ndarray:
    """Shares of the nodes in a uniform traction on a plane face, shape (node_count,)."""
    corners = np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]])
    middles = np.array([[4, 5, 6], [4, 8, 7], [6, 9, 7], [5, 9, 8]])
    faces = elements[:, corners].reshape(-1, 3)
    there = np.isclose(nodes[faces][:, :, axis], place).all(axis=1)
    a, b, c = np.moveaxis(nodes[faces[there]], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    # The integral of a quadratic function of a corner is zero over a triangle, that of a middle a third.
    carries = faces if elements.shape[1] == 4 else elements[:, middles].reshape(-1, 3)
    shares = np.bincount(carries[there].ravel(), np.repeat(area, 3), len(nodes))
    return np.asarray(shares / shares.sum())


def _clamp(width: float = HEIGHT) -> list[dict[str, Any]]:
    return [{"box": [[-1e-6, -1.0, -1.0], [1e-6, width + 1.0, width + 1.0]]}]


def _bar_at_rest(element: str, load: tuple[float, float, float], weight: float = 0.0, loads: int = 1) -> np.ndarray:
    """Mean displacement of the end of the bar [mm] under a force there [mN] and weight of so much a length [mN/mm]."""
    gravity = (0.0, 0.0, -weight / (DENSITY * HEIGHT**2))
    mesh = bar(CELLS[element], (LENGTH, HEIGHT, HEIGHT))
    keys: dict[str, Any] = {
        "element": element,
        "law": "neo-hookean",
        "young_modulus": YOUNG_MODULUS,
        "poisson_ratio": 0.0,
    }
    nodes, motion = rest(mesh, (0, LENGTH), np.array(load), gravity, loads, anchors=_clamp(), **keys)
    return np.asarray(motion[np.isclose(nodes[:, 0], LENGTH)].mean(axis=0))


def elastica(load: float) -> float:
    """Deflection of the end of an inextensible cantilever over its length, by w L^3 / EI, w weight a length.

    th'' = -k (1 - s) cos th, th(0) = 0, th'(1) = 0, for angles th below the level and s from 0 to 1.
    """

    def slopes(s: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.vstack([y[1], -load * (1 - s) * np.cos(y[0]), np.sin(y[0])])

    def ends(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.array([a[0], b[1], a[2]])

    s = np.linspace(0, 1, 101)
    found = solve_bvp(slopes, ends, s, np.vstack([s, 1 - s, s**2 / 2]), tol=1e-8)
    return float(found.y[2, -1])


def elastica_error(element: str, load: float) -> float:
    """Relative error of the bar's deflection under its own weight, by w L^3 / EI."""
    tip = _bar_at_rest(element, (0.0, 0.0, 0.0), load * STIFFNESS / LENGTH**3)
    return float(-tip[2] / LENGTH / elastica(load) - 1.0)


def critical_load_error(element: str) -> float:
    """Relative error of Euler's critical load of a column, pi^2 EI / (4 L^2), from how a compression of half of it
    lets the column give way to a small force across: by 3 (tan u - u) / u^3, u = L sqrt(P / EI)."""
    across, compression = 1e-4 * STIFFNESS / LENGTH**2, np.pi**2 * STIFFNESS / (8 * LENGTH**2)
    alone = _bar_at_rest(element, (0.0, 0.0, across))[2]
    together = _bar_at_rest(element, (-compression, 0.0, across))[2]
    u = brentq(lambda u: 3 * (np.tan(u) - u) / u**3 - together / alone, 1e-3, 0.5 * np.pi - 1e-6)
    return float(compression * (np.pi / 2 / u) ** 2 / (np.pi**2 * STIFFNESS / (4 * LENGTH**2)) - 1.0)


def frequency_error(element: str) -> float:
    """Relative error of the bar's first frequency, 1.8751^2 / (2 pi) sqrt(EI / (rho A L^4)), by the matrices."""
    from taichisoft.bodies.elasticity import ElasticSystem
    from taichisoft.building.simulation import Simulation
    from taichisoft.scenes.file import scene_from_dict

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bar.msh"
        write_volume_mesh(bar(CELLS[element], (LENGTH, HEIGHT, HEIGHT)), path)
        body = {"mesh": str(path), "density": DENSITY, "young_modulus": YOUNG_MODULUS, "poisson_ratio": 0.0}
        body |= {"element": element, "anchors": _clamp()}
        model = Simulation(scene_from_dict({"time": {"step": 1.0}, "soft_bodies": {"bar": body}}, "bar")).model
    assert model.elasticity is not None
    system = ElasticSystem(model.elasticity)
    system.position[:] = model.rest_position
    system.assemble()
    pairs, blocks, count = system.solver.symbolic.block_pairs, system.solver.blocks, model.node_count
    off = pairs[:, 0] != pairs[:, 1]
    row, column = np.concatenate([pairs, pairs[off, ::-1]]).T
    order = np.lexsort((column, row))
    data = np.concatenate([blocks, blocks[off].transpose(0, 2, 1)])[order]
    start = np.searchsorted(row[order], np.arange(count + 1))
    mass = diags_array(np.repeat(model.elasticity.node_mass, 3))
    # M + h^2 K, with a step of 1 s; inverse iteration about 0 finds the lowest frequencies.
    stiffness = bsr_array((data, column[order], start), (3 * count, 3 * count)).tocsc() - mass
    lowest = eigsh(stiffness.tocsc(), 2, mass.tocsc(), sigma=0.0, return_eigenvectors=False).min()
    exact = 1.8751040687**2 * np.sqrt(STIFFNESS / (DENSITY * HEIGHT**2 * LENGTH**4))
    return float(np.sqrt(lowest) / exact - 1.0)


def cook_deflection(element: str, cells: int, poisson_ratio: float = COOK_POISSON) -> float:
    """Rise of the upper corner of Cook's membrane [mm] in plane strain, at large strain.

    A panel of 48 mm, 44 mm high where it is clamped and 16 mm where it is sheared, a cell thick.
    """
    thickness = 44.0 / cells
    mesh = bar((cells, cells, 1), (1.0, 1.0, thickness))
    across, up = mesh.nodes[:, 0].copy(), mesh.nodes[:, 1].copy()
    nodes = np.column_stack([48.0 * across, 44.0 * across + (44.0 - 28.0 * across) * up, mesh.nodes[:, 2]])
    panel = VolumeMesh("Cook's membrane", nodes, mesh.elements, {}).check()
    clamp = {"box": [[-1e-6, -1.0, -1.0], [1e-6, 45.0, 50.0]]}
    faces = [{"box": [[-1.0, -1.0, z - 1e-6], [49.0, 61.0, z + 1e-6]], "directions": ["z"]} for z in (0.0, thickness)]
    keys: dict[str, Any] = {"element": element, "law": "neo-hookean", "anchors": [clamp, *faces]}
    keys |= {"young_modulus": COOK_MODULUS, "poisson_ratio": poisson_ratio}
    load = np.array([0.0, COOK_LOAD * thickness, 0.0])
    rest_nodes, motion = rest(panel, (0, 48.0), load, loads=4, **keys)
    corner = np.isclose(rest_nodes[:, :2], [48.0, 60.0]).all(axis=1)
    return float(motion[corner, 1].mean())


def cook_reference(cells: int, poisson_ratio: float = COOK_POISSON) -> float:
    """The same rise by mixed elements in the plane, which do not lock [mm]."""
    shear, first = COOK_MODULUS / (2 * (1 + poisson_ratio)), poisson_ratio / (1 - 2 * poisson_ratio)
    return corner_rise(cells, shear, 2 * shear * first, COOK_LOAD)


def page_section() -> Iterator[str]:
    """The study as Markdown, line by line."""
    yield "| | linear | smoothed | quadratic |"
    yield "|---|---|---|---|"
    rows = {
        "elastica, w L^3 / EI = 2, deflection": lambda element: elastica_error(element, 2.0),
        "elastica, w L^3 / EI = 10, deflection": lambda element: elastica_error(element, 10.0),
        "Euler's column, critical load": critical_load_error,
        "first frequency of the bar": frequency_error,
    }
    for name, error in rows.items():
        yield f"| {name} | " + " | ".join(f"{error(element):+.1%}" for element in CELLS) + " |"
    for cells in (8, 16):
        found = [f"{cook_deflection(element, cells):.2f} mm" for element in ("linear", "smoothed")]
        found.append(f"{cook_deflection('quadratic', cells // 2):.2f} mm")
        yield f"| Cook's membrane, {cells} cells a side (quadratic {cells // 2}) | " + " | ".join(found) + " |"
    yield f"| Cook's membrane, quadratic, 16 cells a side | | | {cook_deflection('quadratic', 16):.2f} mm |"
    found = [f"{cook_reference(cells):.3f}" for cells in (8, 16, 24)]
    yield f"| Cook's membrane, mixed elements in the plane, 8, 16, 24 cells a side | | | {', '.join(found)} mm |"


def main() -> None:
    """Measure, and fill the page in place."""
    parser = argparse.ArgumentParser(prog="python -m taichisoft_benchmarks.studies.bending")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="PAGE.md", help="page to fill")
    arguments = parser.parse_args()
    try:
        page = arguments.output.read_text(encoding="utf-8")
        if not MARKED.search(page):
            raise BenchmarkError(f"{arguments.output}: has no line <!-- bending -->")
        lines = []
        for line in page_section():
            print(line, flush=True)
            lines.append(line)
        section = "\n".join(lines)
        arguments.output.write_text(MARKED.sub(lambda match: f"{match[1]}{section}\n{match[2]}", page), "utf-8")
    except (TaichisoftError, OSError) as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
