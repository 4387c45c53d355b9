"""One grasp, measured in a process of its own: close, lift fast, shake, hold."""

import math
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.base import WorkerLost, call_apart
from taichisoft.errors import TaichisoftError
from taichisoft_benchmarks.studies.grasped_objects import OBJECTS

if TYPE_CHECKING:  # a simulation brings Taichi
    from taichisoft.control import Control
    from taichisoft.running import Simulation

CLOSED, STILL = 1.2, 1.7
"""When the pressure is reached that rises from 0.2 s on, and when the lift begins [s]."""
LIFT, SPEED, ACCELERATION = 100.0, 500.0, 5000.0
"""How far the base rises [mm], how fast at most [mm/s], and with what acceleration [mm/s^2]."""
SHAKEN_FROM, SHAKEN_TO = 2.5, 3.5
"""When the base is shaken along z [s]."""
FREQUENCY, AMPLITUDE = 5.0, 4.0
"""Of the shaking [1/s and mm]: 0.4 g."""
END = 6.5
"""End of the run [s]; what happens in the second before it is creep."""
TIME_LIMIT = 600.0
"""Longest duration of a grasp [s of wall-clock time]: it usually takes some 10."""


@dataclass(frozen=True)
class MeasuredGrasp:
    """One grasp.

    Attributes:
        object: a key of `OBJECTS`.
        exact: whether its round shape is given as such instead of by triangles.
        mass: of all of it [g].
        pressure: in the three fingers [kPa].
        friction: between all bodies [-].
        element: of the fingers and of a soft object.
    """

    object: str
    exact: bool = False
    mass: float = 30.0
    pressure: float = 80.0
    friction: float = 0.6
    element: str = "linear"

    @property
    def name(self) -> str:
        """What `--only` looks for, and the name of the file of its figures."""
        words = [*self.object.split(), *(["exact"] if self.exact else [])]
        words += [self.element] if self.element != "linear" else []
        return "-".join([*words, f"{self.mass:g}g", f"{self.pressure:g}kPa", f"{self.friction:g}"])


def measure_in_process(grasp: MeasuredGrasp) -> dict[str, Any]:
    """Figures of a grasp, see `measure`; only a `problem`, one line, where there are none."""
    try:
        figures: dict[str, Any] = call_apart(f"{__name__}:measure", grasp, time_limit=TIME_LIMIT)
    except (WorkerLost, TaichisoftError) as error:
        return {"problem": " ".join(str(error).split())}
    return figures


def measure(grasp: MeasuredGrasp) -> dict[str, Any]:
    """Close the fingers, lift the object, shake it, hold it.

    Returns:
        lift: least rise of an object while the base rises by 100 mm [mm].
        creep: largest motion of any object in the last second [mm].
        margin: the friction that the fingers can exert over the weight, before the lift [-].
        steps, unconverged: number of steps, and of unconverged steps.
        sweeps_median, sweeps_most: of the solver in a step.
        penetration: deepest penetration of the contact distance of 1 mm [mm].

    Raises:
        TaichisoftError: the scene is refused, or the simulation diverged.
    """
    from taichisoft.running import Simulation

    with TemporaryDirectory(prefix="taichisoft-grasp-") as folder:
        simulation = Simulation(scene_of(grasp, Path(folder)))
    step, grasped = simulation.model.scene.time.step, _Grasped(simulation)
    reports, places = [], []
    before, margin = grasped.centres(), 0.0
    for index in range(round(END / step)):
        now = index * step
        if abs(now - STILL) < step / 2:
            before = grasped.centres()
            margin = grasp.friction * grasped.normal_force() / (1e-3 * grasp.mass * 9810.0)
        reports.append(simulation.step(control_at(simulation, grasp.pressure, now + step)))
        places.append(grasped.centres())
    held = np.array(places[-round(1.0 / step) - 1 :])
    sweeps = [report.iterations for report in reports]
    return {
        "lift": float((held[-1] - before)[:, 0].min()),
        "creep": float(np.linalg.norm(held - held[0], axis=2).max()),
        "margin": margin,
        "steps": len(reports),
        "unconverged": sum(not report.converged for report in reports),
        "sweeps_median": float(np.median(sweeps)),
        "sweeps_most": max(sweeps),
        "penetration": max(report.max_penetration for report in reports),
    }


class _Grasped:
    """The bodies of a simulation that are not fingers."""

    def __init__(self, simulation: "Simulation"):
        self._simulation = simulation
        self._soft = [body for body in simulation.model.soft_bodies if not body.settings.anchors]
        self._names = [*simulation.model.scene.rigid_bodies, *(body.name for body in self._soft)]

    def centres(self) -> np.ndarray:
        """Centres of mass of rigid bodies, and of the nodes of soft ones [mm], shape (count, 3)."""
        state = self._simulation.state
        return np.array([*state.rigid_position, *(state.position[body.nodes].mean(axis=0) for body in self._soft)])

    def normal_force(self) -> float:
        """Sum of the normal forces of the fingers [mN]."""
        forces = self._simulation.observe().normal_forces
        return sum(
            force
            for pair, force in forces.items()
            if any(name in self._names for name in pair) and any(name.startswith("finger") for name in pair)
        )


def scene_of(grasp: MeasuredGrasp, folder: Path, step: float = 0.01, damping: float | None = None) -> Any:
    """The shipped gripper with other objects, whose base may move as fast as it is asked to.

    Args:
        grasp: the object and how it is grasped.
        folder: where surfaces and meshes are written.
        step: time step [s].
        damping: Rayleigh's factor of the stiffness of the fingers [s]; theirs if None.
    """
    from taichisoft.running import load_scene
    from taichisoft.scene import scene_from_dict

    overrides = [f"contact.friction={grasp.friction}", f"limits.base_speed={10 * SPEED}", f"time.step={step}"]
    tables = load_scene("gripper", overrides).model_dump(mode="json", exclude_none=True)
    del tables["goal"], tables["controller"]
    for finger in tables["soft_bodies"].values():
        finger["rayleigh_stiffness"] = finger["rayleigh_stiffness"] if damping is None else damping
        finger["element"] = grasp.element
    made = OBJECTS[grasp.object](1e-3 * grasp.mass, grasp.exact, folder)
    tables["rigid_bodies"] = made["rigid_bodies"]
    tables["soft_bodies"] |= {name: {**body, "element": grasp.element} for name, body in made["soft_bodies"].items()}
    return scene_from_dict(tables)


def control_at(simulation: "Simulation", pressure: float, time: float) -> "Control":
    """The request for the end of a step."""
    from taichisoft.control import Control

    part = min(max((time - 0.2) / (CLOSED - 0.2), 0.0), 1.0)
    shaken = min(max(time, SHAKEN_FROM), SHAKEN_TO) - SHAKEN_FROM
    aside = AMPLITUDE * math.sin(2 * math.pi * FREQUENCY * shaken)
    smooth = part * part * (3 - 2 * part)
    return Control(
        pressure=dict.fromkeys(simulation.model.cavities.names, pressure * smooth),
        base_translation=np.array([_rise(time - STILL), 0.0, aside]),
    )


def _rise(time: float) -> float:
    """How far the base has risen [mm], so long [s] after it began: speeding up, at full speed, slowing down."""
    speeding, moving = SPEED / ACCELERATION, LIFT / SPEED
    rise = 0.0
    for start, share in ((0.0, 1.0), (speeding, -1.0), (moving, -1.0), (moving + speeding, 1.0)):
        rise += share * ACCELERATION * max(time - start, 0.0) ** 2 / 2
    return rise
