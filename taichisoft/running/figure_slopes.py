"""Takes derivatives by figures of an observation to those by the state, for gradients of runs."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from taichisoft.contact.model import Model
from taichisoft.control.observer import Fingertips
from taichisoft.errors import TaichisoftError
from taichisoft.mechanics.body_geometry import PosesAhead
from taichisoft.mechanics.model_actuators import ACTUATOR_KINDS, ActuatorGeometry
from taichisoft.mechanics.state import State
from taichisoft.step.step_adjoint import Slopes
from taichisoft.step.step_derivative import StepDerivative


class FigureSlopes:
    """Takes derivatives by figures of an observation to those by the state and the impulses of the step before it.

    Attributes:
        tips: the fingertips.
        of_frames: parts of an objective that frames change without a change of the bodies, by a state that has the
            frames; of the last step.
    """

    KNOWN = (
        *("tip_positions", "tip_velocities", "bending_angles"),
        *("object_positions", "object_velocities", "object_angular_velocities"),
        *("pressures", "volumes", "cable_tensions", "cable_lengths", "cable_pulls"),
        *("normal_forces", "friction_forces", "state.position", "state.velocity"),
    )

    def __init__(self, model: Model):
        self._model, self.tips = model, Fingertips(model.soft_bodies, model.frames)
        self.of_frames: list[Callable[[State], float]] = []
        self._geometry = ActuatorGeometry(model.actuators, model.node_count)

    def check(self, name: str) -> None:
        """Refuse a figure without derivatives."""
        field = name if name.startswith("state.") else name.partition(".")[0]
        if field not in self.KNOWN:
            raise TaichisoftError(f"objective: figure '{name}' has no derivative here; take {', '.join(self.KNOWN)}")

    def add(
        self,
        by: Mapping[str, np.ndarray],
        derivative: StepDerivative,
        end: State,
        slopes: Slopes,
        impulse: np.ndarray,
        target: np.ndarray,
    ) -> None:
        """Add those by figures of the end of a step to those by its state, by impulses of rows, and by targets."""
        rigid = [body.name for body in self._model.rigid_bodies]
        self.of_frames = []
        for name, slope in by.items():
            field, _, key = name.partition(".")
            if field == "state":
                getattr(slopes, key)[...] += slope
            elif field.startswith("object_"):
                array = slopes.rigid_position if field == "object_positions" else slopes.rigid_velocity
                columns = slice(3, 6) if "angular" in field else slice(0, 3)
                for number, part in self._entries(rigid, key, slope):
                    array[number, columns] += part
            elif field in ("normal_forces", "friction_forces"):
                self._add_forces(field, key, float(slope), derivative, impulse)
            elif field.startswith(("tip_", "bending")):
                for number, part in self._entries(list(self.tips.names), key, slope):
                    self._add_tip(field, number, part, end, slopes)
            else:
                self._add_actuator(field, key, slope, derivative, end, (slopes, impulse, target))

    @staticmethod
    def _entries(names: Sequence[str], key: str, slope: np.ndarray) -> list[tuple[int, np.ndarray]]:
        return [(names.index(key), slope)] if key else list(enumerate(slope))

    def _add_tip(self, field: str, number: int, slope: np.ndarray, end: State, slopes: Slopes) -> None:
        nodes = self.tips.nodes[number]
        if field == "tip_positions":
            slopes.position[nodes] += slope / len(nodes)
        elif field == "tip_velocities":
            slopes.velocity[nodes] += slope / len(nodes)
        else:
            body = next(body for body in self._model.soft_bodies if body.name == self.tips.names[number])
            rest = self._model.rest_position[nodes]
            rest = rest - rest.mean(axis=0)
            (frame,) = self._model.frames.numbers([body.settings.follows])
            turn = self._model.places(end).turn[frame]
            slopes.position[nodes] += float(slope) * _angle_slopes(end.position[nodes], rest, turn)
            self.of_frames.append(
                lambda moved: float(slope * self.tips.observe(end.changed(frame_pose=moved.frame_pose))[2][number])
            )

    def _add_forces(self, field: str, key: str, slope: float, derivative: StepDerivative, impulse: np.ndarray) -> None:
        pair = sorted(self._model.body_names.index(name) for name in key.split("|"))
        bodies = derivative.problem.contacts.found.bodies[derivative.contacts]
        for number in np.flatnonzero((np.sort(bodies, axis=1) == pair).all(axis=1)):
            rows, h = slice(3 * number, 3 * number + 3), self._model.scene.time.step
            own = derivative.impulse[rows]
            if field == "normal_forces":
                impulse[rows][0] += slope / h
            elif own[1:].any():
                impulse[rows][1:] += slope / h * own[1:] / np.linalg.norm(own[1:])

    def _add_actuator(
        self,
        field: str,
        key: str,
        slope: np.ndarray,
        derivative: StepDerivative,
        end: State,
        parts: tuple[Slopes, np.ndarray, np.ndarray],
    ) -> None:
        actuators, (slopes, impulse, target) = self._model.actuators, parts
        kind = next(
            kind
            for kind in ACTUATOR_KINDS
            if field in (kind.effort.observed, kind.coordinate.observed, kind.value.observed)
        )
        first, place = actuators.first_coordinate, actuators.place(kind)
        for number, part in self._entries(list(actuators.names_of(kind)), key, slope):
            coordinate = int(first[place.start + number])
            if field == kind.effort.observed:
                rows = np.flatnonzero(derivative.coordinates == coordinate)
                if len(rows):
                    impulse[3 * derivative.contact_count + rows[0]] += part / self._model.scene.time.step
                else:
                    target[place.start + number] += part
                continue
            sign = actuators.sign[place.start + number] if field == kind.coordinate.observed else 1.0
            weight, actuator = float(sign * part), place.start + number
            self.of_frames.append(lambda moved, w=weight, i=actuator: w * self._values(end, moved)[i])  # type: ignore[misc]
            self._values(end, end)
            own = slice(*actuators.coordinates.entry_start[coordinate : coordinate + 2].tolist())
            by_coordinate = weight * actuators.sign[actuator] * self._geometry.gradient.soft[own]
            np.add.at(slopes.position, actuators.coordinates.entry_node[own], by_coordinate)

    def _values(self, end: State, frames: State) -> np.ndarray:
        """Volumes and lengths of all actuators with the bodies of a state and the frames of another."""
        ahead = PosesAhead(end.position, end.rigid_position, end.rigid_rotation)
        self._geometry.update(ahead, self._model.placed_pull_points(frames))
        return self._geometry.value


def _angle_slopes(position: np.ndarray, rest: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """Derivatives of a bending angle by the nodes of the tip [1/mm]; 0 of a straight one, which has none."""
    fitted = (position - position.mean(axis=0)).T @ rest
    left, _, right = np.linalg.svd(fitted)
    left[:, 2] *= np.linalg.det(left @ right)
    turn = left @ right
    of_frame = frame.T @ turn
    axis = np.array([of_frame[k - 1, k - 2] - of_frame[k - 2, k - 1] for k in range(3)])
    sine = np.linalg.norm(axis)
    if sine < 1e-9:
        return np.zeros_like(position)
    stretch = turn.T @ fitted
    moment = np.linalg.solve(np.trace(stretch) * np.eye(3) - stretch, axis / sine)
    by_fitted = turn @ np.cross(np.eye(3), moment)
    slopes: np.ndarray = rest @ by_fitted.T
    return slopes
