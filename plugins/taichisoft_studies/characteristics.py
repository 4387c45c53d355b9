"""Characteristics of a finger: how far it bends, how hard it presses, and their data sheet."""

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

import taichisoft
from taichisoft import Scene
from taichisoft.base import atomic_file, read_arrays, warn_caller
from taichisoft.control import Control, Fingertips, Observation
from taichisoft.mechanics import State
from taichisoft.scene import scene_to_toml
from taichisoft_outputs.html_template import render, svg_element
from taichisoft_outputs.plots import Panel, PlotCurve, files_of
from taichisoft_studies.errors import StudyError
from taichisoft_studies.run_job import run_hash

# What a finger can do: how far it bends by its pressure, and how hard it presses where it is held up.

BLOCK = "characteristics-block"
"""Name of the obstacle that holds up the tip."""
BLOCK_SIZE = 3.0
"""Width of the block, in radii of the tip [-]."""
WARNING = "warning"


@dataclass(frozen=True)
class Characteristics:
    """Curves of a finger at rest under a number of pressures.

    Attributes:
        pressures: of all its cavities [kPa], shape (pressure_count,).
        bending: angle by which the tip has turned [degrees], shape (pressure_count,).
        travel: distance of the tip along its path [mm], shape (pressure_count,).
        volumes: of all its cavities together [mm^3], shape (pressure_count,).
        blocked: numbers of the pressures whose bends a block holds, shape (bend_count,).
        forces: normal force on the block [mN], shape (bend_count, pressure_count); NaN below the pressure of the bend.
        atmosphere: absolute pressure of the surroundings [kPa].
    """

    pressures: np.ndarray
    bending: np.ndarray
    travel: np.ndarray
    volumes: np.ndarray
    blocked: np.ndarray
    forces: np.ndarray
    atmosphere: float

    @property
    def air(self) -> np.ndarray:
        """Air that a syringe lets in, as its volume at the pressure of the surroundings [mm^3], (pressure_count,).

        By Boyle's law, of cavities that were open before; air in tubes and syringe comes on top.
        """
        growth: np.ndarray = self.volumes * (1.0 + self.pressures / self.atmosphere) - self.volumes[0]
        return growth

    @property
    def stiffness(self) -> np.ndarray:
        """Force on a block for each millimetre by which it holds the tip back [mN/mm], shape (pressure_count,).

        It is the secant from the free bend to the nearest bend that a block holds; NaN where none is less.
        """
        result = np.full(len(self.pressures), np.nan)
        for number in range(len(self.pressures)):
            before = [row for row, held in enumerate(self.blocked) if held < number]
            if before:
                row = before[-1]
                result[number] = self.forces[row, number] / (self.travel[number] - self.travel[self.blocked[row]])
        return result


def find_characteristics(
    scene: Scene,
    body: str | None,
    pressures: Sequence[float],
    bends: int,
    done: Callable[[str], None] = lambda line: None,
    folder: Path | None = None,
) -> Characteristics:
    """Find the equilibria of a finger, free and against blocks: without inertia, so without a time to wait for.

    Rigid bodies, obstacles and other soft bodies of the scene are left out; its gravity stays. A block is a box across
    the path of the tip, where it touches the tip at one of the pressures, and stays there for the higher ones.

    Args:
        scene: the scene.
        body: name of the finger; None for the only one, or the first.
        pressures: pressures from 0, all rising or all falling [kPa].
        bends: number of bends that are held, from the first pressure on, evenly spaced.
        done: called with "" for each equilibrium that is found; `equilibrium_count` says of how many.
        folder: where each equilibrium is kept, and those of an earlier, interrupted search are taken from.
    """
    name = body or next(iter(scene.soft_bodies), "")
    if name not in scene.soft_bodies or not scene.soft_bodies[name].cavities:
        known = [body for body, settings in scene.soft_bodies.items() if settings.cavities]
        raise StudyError(f"--body {name}: no soft body with a cavity is called so; there are: {', '.join(known)}")
    alone = scene.model_copy(
        update={
            "soft_bodies": {name: scene.soft_bodies[name]},
            "rigid_bodies": {},
            "obstacles": {},
            "external_forces": [],
            "goal": None,
        }
    )
    cavities = [f"{name}.{cavity}" for cavity in scene.soft_bodies[name].cavities]
    held = _held(len(pressures), bends)
    free = taichisoft.Simulation(alone)
    found_tips = Fingertips(free.model.soft_bodies, free.model.frames).nodes
    if not found_tips:
        raise StudyError(f"soft_bodies.{name}: has no tip, since it has neither anchors nor `tip`")
    (nodes,), states, seen = found_tips, [], []
    for number, pressure in enumerate(pressures):
        seen.append(_at_rest(free, cavities, pressures[: number + 1], folder))
        actual = seen[-1].pressures
        wrong = next((cavity for cavity in cavities if abs(actual[cavity] - pressure) > 1e-6 * abs(pressure)), None)
        if wrong is not None:
            raise StudyError(f"{pressure:g} kPa: the scene's limits hold '{wrong}' at {actual[wrong]:g} kPa")
        states.append(free.state)
        done("")
    tips = np.array([observation.tip_positions[name] for observation in seen])
    steps = np.linalg.norm(np.diff(tips, axis=0), axis=1)
    if not (steps > 0.0).all():
        raise StudyError(f"soft_bodies.{name}: its tip does not move under pressure, so nothing can hold it up")
    along = np.gradient(tips, axis=0)
    forces = np.full((len(held), len(pressures)), np.nan)
    for row, first in enumerate(held):
        forces[row, first] = 0.0
        block = _block(states[first].position, nodes, along[first], scene.contact.contact_distance)
        against = {**alone.model_dump(exclude_none=True), "obstacles": {BLOCK: block}}
        blocked = taichisoft.Simulation(taichisoft.scene_from_dict(against))
        blocked.restore(states[first])
        for number in range(first + 1, len(pressures)):
            rest = _at_rest(blocked, cavities, pressures[: number + 1], folder)
            forces[row, number] = rest.normal_forces.get((name, BLOCK), 0.0)
            done("")
    bending = np.degrees([observation.bending_angles[name] for observation in seen])
    volumes = np.array([sum(observation.volumes[cavity] for cavity in cavities) for observation in seen])
    travel = np.concatenate([[0.0], np.cumsum(steps)])
    return Characteristics(np.array(pressures), bending, travel, volumes, held, forces, scene.atmosphere)


def _at_rest(
    simulation: taichisoft.Simulation, cavities: Sequence[str], pressures: Sequence[float], folder: Path | None
) -> Observation:
    """What is seen at rest under the last of these pressures, where the simulation then is.

    It is found from the one before, or read from the file that was kept of it, which is named after the scene and all
    pressures, on which the equilibrium may depend.
    """
    scene, watched = simulation.model.scene, {"pressures": str(list(pressures))}
    place = None if folder is None else folder / f"{run_hash(scene, None, 0, (), watched)}.npz"
    kept = _kept(place)
    if kept:
        warning = str(kept.pop(WARNING))
        state = State(time=float(kept.pop("time")), step=int(kept.pop("step")), **kept)
        if warning:
            warn_caller(warning)
        simulation.warn_beyond_law(state)
    else:
        rest = taichisoft.equilibrium(simulation, Control(pressure=dict.fromkeys(cavities, pressures[-1])))
        state = rest.state
        if place is not None:
            arrays: dict[str, Any] = {field.name: getattr(state, field.name) for field in fields(state)}
            arrays[WARNING] = np.array(rest.warning)
            with atomic_file(place, StudyError) as partial, partial.open("wb") as file:
                np.savez(file, **arrays)
    simulation.restore(state)
    return simulation.observe().truth


def _kept(place: Path | None) -> dict[str, Any]:
    """The arrays of an equilibrium that was kept; nothing where it was not, or is damaged."""
    try:
        return {} if place is None else read_arrays(place)
    except (OSError, ValueError):
        return {}


def equilibrium_count(pressures: int, bends: int) -> int:
    """How many equilibria are searched for so many pressures and bends."""
    return pressures + int((pressures - 1 - _held(pressures, bends)).sum())


def _held(pressures: int, bends: int) -> np.ndarray:
    return np.unique(np.linspace(0, pressures - 2, bends).astype(int))


def _block(position: np.ndarray, nodes: np.ndarray, along: np.ndarray, distance: float) -> dict[str, Any]:
    """The table of an obstacle: a box a contact's distance before the tip, its face across the tip's direction."""
    from scipy.spatial.transform import Rotation

    direction = along / np.linalg.norm(along)
    middle = position[nodes].mean(axis=0)
    size = BLOCK_SIZE * float(np.linalg.norm(position[nodes] - middle, axis=1).max())
    offset = position - middle
    beside = np.linalg.norm(offset - np.outer(offset @ direction, direction), axis=1)
    reach = float((offset @ direction)[beside < size].max()) + distance
    centre = middle + (reach + size / 2) * direction
    rotation, _ = Rotation.align_vectors([direction], [[1.0, 0.0, 0.0]])
    angles = rotation.as_euler("xyz", degrees=True).tolist()
    return {"box": [size, size, size], "rotation": angles, "translation": centre.tolist()}


# The characteristics of a finger for people: a table, curves, and a page.

TEMPLATE = Path(__file__).with_name("characteristics.html")
TABLE, PICTURE, PAGE = "characteristics.csv", "characteristics.png", "datasheet.html"
PRESSURE = "pressure [kPa]"
SECOND = ", second mesh"
"""Ends the names of what was found on the other mesh."""


def write_datasheet(
    folder: Path, scene: Scene, first: Characteristics, second: Characteristics | None, change: str
) -> list[Path]:
    """Write the table, the picture and the page of a finger's characteristics, and return their paths.

    Args:
        folder: where they are written.
        scene: the scene.
        first: what was found.
        second: what was found on another mesh, whose difference tells the error; None without one.
        change: how the other mesh differs; "" without one.
    """
    folder.mkdir(parents=True, exist_ok=True)
    columns = _columns(first)
    if second is not None:
        columns |= {f"{name}{SECOND}": values for name, values in _columns(second).items() if name != PRESSURE}
    rows = [[_text(value) for value in row] for row in zip(*columns.values(), strict=True)]
    with atomic_file(folder / TABLE, StudyError) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([list(columns), *rows])
    panels = _panels(first, second)
    with atomic_file(folder / PICTURE, StudyError) as partial:
        partial.write_bytes(files_of(panels, ["", SECOND], "png")[0])
    last = first.pressures[-1]
    page = render(
        TEMPLATE,
        title=f"{scene.title or 'finger'}: characteristics",
        status=f"at rest under pressures from 0 to {last:g} kPa, free and held up by blocks",
        headlines=[
            (f"bending at {last:g} kPa", f"{_text(first.bending[-1], 3)} degrees"),
            (f"force of the straight finger at {last:g} kPa", f"{_text(first.forces[0, -1], 3)} mN"),
            (f"stiffness of the tip at {last:g} kPa", f"{_text(first.stiffness[-1], 3)} mN/mm"),
            ("growth of the chambers", f"{_text((first.volumes[-1] - first.volumes[0]) / 1e3, 3)} cm³"),
            (f"air from a syringe at {first.atmosphere:.4g} kPa", f"{_text(first.air[-1] / 1e3, 3)} cm³"),
        ],
        plots=[svg_element(one.decode()) for one in files_of(panels, ["", SECOND], "svg", columns_apart=True)],
        columns=list(columns),
        rows=rows,
        trust=trust_line(first, second, change),
        scene=scene_to_toml(scene),
    )
    with atomic_file(folder / PAGE, StudyError) as partial:
        partial.write_text(page, encoding="utf-8")
    return [folder / name for name in (TABLE, PICTURE, PAGE)]


def trust_line(first: Characteristics, second: Characteristics | None, change: str) -> str:
    """How much another mesh changes, which is about the error of the first one where the other is finer."""
    if second is None:
        return "There is no second mesh, so nothing is known of the error of this one."
    bend = _largest_difference(first.bending, second.bending)
    force = _largest_difference(first.forces, second.forces)
    return (
        f"With {change}, bending differs by up to {100 * bend:.1f} % of its largest value, and forces by up to "
        f"{100 * force:.1f} %."
    )


def _largest_difference(first: np.ndarray, second: np.ndarray) -> float:
    return float(np.nanmax(np.abs(second - first)) / (np.nanmax(np.abs(second)) or 1.0))


def _columns(curves: Characteristics) -> dict[str, np.ndarray]:
    held = {
        f"force held at {curves.pressures[number]:g} kPa [mN]": forces
        for number, forces in zip(curves.blocked, curves.forces, strict=True)
    }
    free = {
        "bending [degrees]": curves.bending,
        "travel of the tip [mm]": curves.travel,
        "volume of the chambers [cm³]": curves.volumes / 1e3,
        f"air let in, at {curves.atmosphere:.4g} kPa [cm³]": curves.air / 1e3,
    }
    return {PRESSURE: curves.pressures, **free, **held, "stiffness [mN/mm]": curves.stiffness}


def _text(value: float, digits: int = 5) -> str:
    """A number without what solvers leave over, and nothing where it is not known."""
    return "" if np.isnan(value) else f"{round(float(value), 6) + 0.0:.{digits}g}"


def _panels(first: Characteristics, second: Characteristics | None) -> dict[str, Panel]:
    panels: dict[str, Panel] = {}

    def add(y_axis: str, label: str, x: np.ndarray, y: np.ndarray, x_axis: str = PRESSURE) -> None:
        curve = PlotCurve(label, SECOND if label.endswith(SECOND) else "", x, y, np.arange(len(x), dtype=float))
        panels.setdefault(y_axis, Panel(x_axis, y_axis, [])).curves.append(curve)

    for of, mesh in (("", first), *([(SECOND, second)] if second is not None else [])):
        add("bending angle [degrees]", f"free{of}", mesh.pressures, mesh.bending)
        for number, forces in zip(mesh.blocked, mesh.forces, strict=True):
            held = f"held at {_text(mesh.bending[number], 3)} degrees, {mesh.pressures[number]:g} kPa{of}"
            add("force on the block [mN]", held, mesh.pressures, forces)
        add("stiffness of the tip [mN/mm]", f"secant{of}", mesh.pressures, mesh.stiffness)
        bends, last = np.append(mesh.bending[mesh.blocked], mesh.bending[-1]), np.append(mesh.forces[:, -1], 0.0)
        axis = "bend at which the tip is held [degrees]"
        add(f"force at {first.pressures[-1]:g} kPa [mN]", f"over its bend{of}", bends, last, axis)
    return panels
