"""Two ways out of an overlap, `contact.depth` "position" and "velocity", side by side.

    python -m taichisoft_benchmarks.studies.depth

prints a table in Markdown, which stands in docs/design.md. Without restitution nothing should rise: height gained, and
depth that is left, are errors.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft_benchmarks.studies.grasp_cases import Grasp
from taichisoft_benchmarks.studies.grasp_measure import STILL, control_at, scene_of

if TYPE_CHECKING:  # a simulation brings Taichi
    from taichisoft.building.simulation import Simulation
    from taichisoft.control.control import Control

METHODS = ("position", "velocity")
HEADINGS = ("case", "`contact.depth`", "rises, mm", "depth after 1 step, mm", "at the end, mm", "sweeps")
FLOOR = {"plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}
DISTANCE = 1.0
"""Contact distance of the scenes [mm]."""


def _boxes(depth: str, sunk: float, count: int) -> "Simulation":
    """Boxes of 20 mm on each other, each of which has sunk so far into what is below it [mm]."""
    bodies = {
        f"box{k}": {"box": [20] * 3, "mass": 0.01, "position": [0, 0, 10 + DISTANCE + (20 + DISTANCE) * k]}
        for k in range(count)
    }
    simulation = _on_the_floor(depth, bodies)
    sinking = [[0.0, 0.0, sunk * (k + 1)] for k in range(count)]
    simulation.restore(replace(simulation.state, rigid_position=simulation.state.rigid_position - sinking))
    return simulation


def _drop(depth: str, spin: float) -> "Simulation":
    """A box that falls on the floor at 2 m/s, turning so fast [rad/s] that its corners sink in when they strike."""
    box = {"box": [20] * 3, "mass": 0.01, "position": [0, 0, 60], "rotation": [20, 35, 0], "velocity": [0, 0, -2000]}
    return _on_the_floor(depth, {"box": {**box, "angular_velocity": [spin, 0, 0]}})


def _on_the_floor(depth: str, bodies: dict[str, Any]) -> "Simulation":
    from taichisoft.building.simulation import Simulation
    from taichisoft.scenes.file import scene_from_dict

    tables = {"rigid_bodies": bodies, "obstacles": {"floor": FLOOR}, "contact": {"depth": depth}}
    return Simulation(scene_from_dict({"gravity": [0.0, 0.0, -9810.0], "time": {"step": 0.01}, **tables}))


def _grasp(depth: str) -> "Simulation":
    """The shipped gripper about a cube of 30 g."""
    from taichisoft.building.simulation import Simulation
    from taichisoft.scenes.file import scene_from_dict

    with TemporaryDirectory(prefix="taichisoft-depth-") as folder:
        tables = scene_of(Grasp("cube"), Path(folder)).model_dump(mode="json", exclude_none=True)
        tables["contact"]["depth"] = depth
        return Simulation(scene_from_dict(tables))


CASES: dict[str, tuple[Callable[[str], "Simulation"], float, int]] = {
    "a box, sunk by 0.9 mm": (lambda depth: _boxes(depth, 0.9, 1), 0.3, 2),
    "three boxes, sunk by 0.4 mm each": (lambda depth: _boxes(depth, 0.4, 3), 0.3, 2),
    "a box dropped at 2 m/s": (lambda depth: _drop(depth, 0.0), 0.5, 2),
    "the same, turning at 60 rad/s": (lambda depth: _drop(depth, 60.0), 0.5, 2),
    "a cube of 30 g in the gripper, closed": (_grasp, STILL, 0),
}
"""How to begin, seconds, and the coordinate that is up."""


def measure(begin: Callable[[str], "Simulation"], depth: str, seconds: float, up: int) -> list[str]:
    """Largest rise of a body above its lowest place after a step, depths, and sweeps in all."""
    simulation = begin(depth)
    risen, depths, sweeps = 0.0, [], 0
    lowest = np.full(len(simulation.state.rigid_position), np.inf)
    for index in range(round(seconds / simulation.model.scene.time.step)):
        report = simulation.step(_control(simulation, index))
        depths.append(report.max_penetration)
        sweeps += report.iterations
        height = simulation.state.rigid_position[:, up]
        lowest = np.minimum(lowest, height)
        risen = max(risen, float((height - lowest).max()))
    return [f"{risen:.2g}", f"{depths[1]:z.1g}", f"{depths[-1]:z.1g}", str(sweeps)]


def _control(simulation: "Simulation", index: int) -> "Control | None":
    if not simulation.model.cavities.names:
        return None
    return control_at(simulation, 80.0, (index + 1) * simulation.model.scene.time.step)


def main() -> None:
    """Measure all, one after the other."""
    print(f"| {' | '.join(HEADINGS)} |\n|{len(HEADINGS) * '---|'}")
    for name, (begin, seconds, up) in CASES.items():
        for depth in METHODS:
            print(f"| {name} | {depth} | {' | '.join(measure(begin, depth, seconds, up))} |", flush=True)


if __name__ == "__main__":
    main()
