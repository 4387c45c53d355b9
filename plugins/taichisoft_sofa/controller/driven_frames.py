"""Frames of a scene that joints drive, and the soft bodies' nodes that follow them."""

import numpy as np
from scipy.spatial.transform import Rotation

from taichisoft.errors import SceneError
from taichisoft_sofa.components.frames import FramePoses, bases_of, start_values
from taichisoft_sofa.components.reading import STATE, described, flag, mapping_of, number, numbers
from taichisoft_sofa.components.states import is_rigid, width_of
from taichisoft_sofa.loading import SceneTree
from taichisoft_sofa.translation.parts import Joint, Translation
from taichisoft_sofa.tree.component import Component
from taichisoft_sofa.tree.value_kinds import POINT, canonical

SPRING = 100.0
"""SOFA's default stiffness of rest shape springs, here of angles [mN mm]."""


class JointMotion:
    """Angles of a joint under its springs and Rayleigh damping, by implicit Euler as in SOFA, without other torques.

    Attributes:
        state: mechanical object of the angles.
        angle: angles [rad], shape (count,).
        velocity: angular velocities [rad/s], shape (count,).
    """

    def __init__(self, joint: Joint) -> None:
        self.state = joint.state
        self._joint = joint
        self.angle = start_values(joint.state).ravel().copy()
        self.velocity = np.zeros_like(self.angle)

    def take_written(self) -> None:
        """Take the angles that the scene wrote since the last step."""
        data = self._joint.state.findData("position")
        assert data is not None
        if (written := data.take()) is not None:
            self.angle, self.velocity = np.array(written, dtype=np.float64).ravel(), np.zeros(np.size(written))

    def advance(self, time_step: float) -> None:
        """Move by a time step [s].

        Raises:
            SceneError: an angle is not held any more, or `rest_position` has another number of angles.
        """
        self.take_written()
        solver = self._joint.solver
        if solver is None:
            return
        stiffness, rest = self._stiffness(), self._rest()
        mass = self._joint.mass
        stretched = rest - self.angle
        if flag(solver, "firstOrder", False):
            self.velocity = stiffness * stretched / (mass + time_step * stiffness)
        else:
            lag = time_step + number(solver, "rayleighStiffness", default=0.0)
            drag = mass * number(solver, "rayleighMass", default=0.0)
            force = stiffness * (stretched - lag * self.velocity) - drag * self.velocity
            inertia = mass + time_step * drag + time_step * lag * stiffness
            self.velocity = self.velocity + time_step * force / inertia
        self.angle = self.angle + time_step * self.velocity

    def _stiffness(self) -> np.ndarray:
        springs = self._joint.springs
        given = numbers(springs, "stiffness", default=[SPRING])
        points = numbers(springs, "points", "indices").astype(np.int64)
        chosen = points if len(points) else np.arange(len(self.angle))
        stiffness = np.zeros(len(self.angle))
        if len(chosen) and (chosen.min() < 0 or chosen.max() >= len(self.angle)):
            raise SceneError(f"{described(springs)}: names an angle outside 0..{len(self.angle) - 1}")
        stiffness[chosen] = given if len(given) == len(chosen) else given[0]
        if (stiffness <= 0.0).any():
            raise SceneError(f"{described(springs)}: stiffness = 0: an angle that nothing holds is not known here")
        return stiffness

    def _rest(self) -> np.ndarray:
        data = self._joint.state.findData("rest_position")
        # Not the computed value, which does not follow a link to a data that the scene changes.
        rest = start_values(self._joint.state) if data is None or not data.is_set() else data.given()
        if np.size(rest) != len(self.angle):
            where = f"{described(self._joint.state)}: rest_position"
            raise SceneError(f"{where} has {np.size(rest)} angles; {len(self.angle)} are needed")
        return np.ravel(rest)


class DrivenFrames:
    """The driven frames of a run."""

    def __init__(self, tree: SceneTree, translation: Translation):
        """Begin at the start of the scene."""
        self._joints = {id(joint.state): JointMotion(joint) for joint in translation.joints}
        self._parts = {name: part for name, part in translation.soft.items() if part.targets}
        self._driven = [component for component in tree.components() if self._is_driven(component)]
        self._poses = FramePoses(start_values)
        self._time = 0.0
        self._sprung, self._frames = translation.sprung, translation.driven

    def advance(self, time_step: float) -> None:
        """Move all joints by a time step [s], and all frames with them."""
        for joint in self._joints.values():
            joint.advance(time_step)
        self._poses = FramePoses(self._present)
        self._time += time_step

    def anchor_positions(self, name: str, positions: np.ndarray) -> bool:
        """Write the places of the nodes of a soft body that follow targets into the places of its anchors [mm].

        Returns:
            Whether there are such nodes.
        """
        targets = self._parts[name].targets if name in self._parts else ()
        for target, nodes, rows in targets:
            positions[nodes] = target.places(rows, self._time, self._poses)
        return bool(targets)

    def frame_poses(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Translations [mm] and rotation vectors [rad] of the native frames from the start, by name."""
        start, translations, rotations = FramePoses(start_values), dict[str, np.ndarray](), dict[str, np.ndarray]()
        for name, (state, index) in self._frames.items():
            before, now = start.of(state)[index], self._poses.of(state)[index]
            translations[name] = now[:3] - before[:3]
            if len(now) > POINT:
                turn = Rotation.from_quat(now[3:]) * Rotation.from_quat(before[3:]).inv()
                rotations[name] = turn.as_rotvec()
        return translations, rotations

    @property
    def joints(self) -> list[JointMotion]:
        """Motion of the joints."""
        return list(self._joints.values())

    @property
    def frames(self) -> list[Component]:
        """Mechanical objects of the frames that joints move."""
        return self._driven

    def poses(self, state: Component) -> np.ndarray:
        """Present poses of a mechanical object's frames [mm], shape (frame_count, 7)."""
        return self._poses.of(state)

    def _present(self, state: Component) -> np.ndarray:
        if id(state) in self._joints:
            return self._joints[id(state)].angle
        rest = state.findData("rest_position") if state in self._sprung else None
        if state in self._sprung:
            given = rest is not None and rest.is_set()
            return (
                np.reshape(rest.given(), (-1, width_of(state))) if rest is not None and given else start_values(state)
            )
        data = state.findData("position")
        assert data is not None
        return np.reshape(data.read_value(), (-1, width_of(state)))

    def _is_driven(self, component: Component) -> bool:
        if canonical(component.type_name) != STATE or mapping_of(component) is None or not is_rigid(component):
            return False
        return any(width_of(base) == 1 for base in bases_of(component))
