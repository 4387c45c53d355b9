"""An output that keeps of a run what training and validation need."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from taichisoft import Model, Output, State, StepReport
from taichisoft.mechanics import ACTUATOR_KINDS
from taichisoft_outputs.run_figures import Slipping
from taichisoft_reduction.body_shapes import relative_motions
from taichisoft_reduction.run_request import RunResult


class RunFigures:
    """Figures of a run by which a full and a reduced model are compared."""

    def __init__(self, bodies: Sequence[str], model: Model, state: State):
        """Begin at a state; with the forces on `bodies`."""
        self._bodies, self._model, self._first = bodies, model, state
        self._slipping = Slipping(len(model.soft_bodies), state)
        self._slid = np.zeros((len(model.rigid_bodies), 3))

    def add(self, state: State) -> None:
        """Follow a step; to be called after each."""
        self._slid += self._slipping.add(state)

    def at(self, state: State, report: StepReport) -> dict[str, float]:
        """Values by name with unit after a step, such as "lift of cube [mm]"."""
        seen, model = report.observation.truth, self._model
        found = {f"bending of {name} [deg]": math.degrees(angle) for name, angle in seen.bending_angles.items()}
        found |= {f"imbalance of {name} [mm]": way for name, way in report.imbalance.items()}
        found |= {f"volume of {name} [mm^3]": volume for name, volume in seen.volumes.items()}
        forces = dict.fromkeys(self._pairs(), 0.0) | {
            pair: force for pair, force in seen.normal_forces.items() if pair in self._pairs()
        }
        found |= {f"force of {one} on {other} [mN]": force for (one, other), force in forces.items()}
        ways = state.rigid_position - self._first.rigid_position
        for body, way, slid in zip(model.rigid_bodies, ways, self._slid, strict=True):
            found[f"lift of {body.name} [mm]"] = float(way @ model.scene.up)
            found[f"slip of {body.name} [mm]"] = float(np.linalg.norm(slid))
        return found

    def _pairs(self) -> list[tuple[str, str]]:
        """Each kept body with each other body of the scene, in the scene's order."""
        names = self._model.body_names
        order = {name: number for number, name in enumerate(names)}
        pairs = {tuple(sorted((one, other), key=order.__getitem__)) for one in self._bodies for other in names}
        return sorted(((a, b) for a, b in pairs if a != b), key=lambda pair: (order[pair[0]], order[pair[1]]))


class RunFrames(Output):
    """Keeps displacements and figures in some steps, evenly spread over the run."""

    def __init__(self, bodies: Sequence[str], step_count: int, frames: int):
        """Keep the displacements of `bodies` in at most `frames` of `step_count` steps."""
        self._bodies = bodies
        self._every = max(1, math.ceil(step_count / frames))
        self._time: list[float] = []
        self._figures: list[dict[str, float]] = []
        self._displacement: dict[str, list[np.ndarray]] = {name: [] for name in bodies}
        self._touched: dict[str, np.ndarray] = {}
        self._begun = False

    def begin(self, model: Model, state: State) -> None:
        """See `Output`."""
        self._begun = True
        self._model, self._last = model, state
        self._motions = relative_motions(model, self._bodies)
        self._nodes = {body.name: body.nodes for body in model.soft_bodies}
        frames = zip(model.soft_bodies, model.soft_frame.tolist(), strict=True)
        self._frame = {body.name: frame for body, frame in frames}
        self._touched = {name: np.zeros(len(model.rest_position[self._nodes[name]]), bool) for name in self._bodies}
        self._run_figures = RunFigures(self._bodies, model, state)
        self._lowest = state.actuator_target.copy()
        self._highest = state.actuator_target.copy()

    def record(self, state: State, report: StepReport) -> None:
        """See `Output`."""
        self._run_figures.add(state)
        self._lowest = np.minimum(self._lowest, state.actuator_target)
        self._highest = np.maximum(self._highest, state.actuator_target)
        self._last = state
        if state.step % self._every or report.inverted_elements:
            return
        self._time.append(state.time)
        places = self._model.places(state)
        for name, motion in self._motions.items():
            displacement = motion.displacement(state.position[self._nodes[name]], places, self._frame[name])
            self._displacement[name].append(displacement.astype(np.float32))
        self._note_touched(state)
        self._figures.append(self._run_figures.at(state, report))

    def result(self, name: str, problem: str, steps_per_second: float) -> RunResult:
        """What was kept; nothing of a run that never began."""
        if not self._begun:
            return RunResult(name, problem, np.zeros(0), {}, {})
        names = self._figures[0] if self._figures else {}
        return RunResult(
            name=name,
            problem=problem,
            time=np.array(self._time),
            displacement={
                body: np.array(frames, np.float32).reshape(len(frames), len(self._touched[body]), 3)
                for body, frames in self._displacement.items()
            },
            figures={key: np.array([one.get(key, 0.0) for one in self._figures]) for key in names},
            touched=self._touched,
            drives=self._drives(),
            steps_per_second=steps_per_second,
        )

    def _note_touched(self, state: State) -> None:
        pressing = np.einsum("cd,cd->c", state.contact_impulse, state.contact_normal) > 0.0
        for number, body in enumerate(self._model.soft_bodies):
            mine = pressing & (state.contact_body_pair == number).any(axis=1)
            if body.name in self._touched and mine.any():
                near = cKDTree(state.position[body.nodes]).query(state.contact_point[mine])[1]
                self._touched[body.name][near] = True

    def _drives(self) -> dict[str, Any]:
        """By actuator, the key that drove it at the end, and the smallest and largest value."""
        found, actuators = {}, self._model.actuators
        for kind in ACTUATOR_KINDS:
            place = actuators.place(kind)
            for name, number in zip(actuators.names_of(kind), range(place.start, place.stop), strict=True):
                drive = kind.coordinate if self._last.actuator_imposed[number] else kind.effort
                found[name] = (drive.asked, float(self._lowest[number]), float(self._highest[number]))
        return found
