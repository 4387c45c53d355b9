"""The wrench on the base: what a sensor of forces and torques between gripper and robot would show."""

import numpy as np

from taichisoft.actuators.lines import Line, moved_with_base
from taichisoft.model import Model
from taichisoft.state import State
from taichisoft.step.rigid_motion import CarriedBodies
from taichisoft.step.solution import ForcesOnBase, StepSolution


class BaseWrench:
    """Sums up what anchored soft bodies, bodies that it carries, and cables that it pulls exert on the base."""

    def __init__(self, model: Model):
        """Find the cables, and the bodies that the base carries."""
        self._model, actuators = model, model.actuators
        reduced = [np.arange(body.nodes.start, body.nodes.stop) for body in model.soft_bodies if body.modes is not None]
        self._reduced_nodes = np.concatenate([*reduced, np.zeros(0, dtype=int)]).astype(int)
        pulled = [line for line in model.cables.lines if line.has_pull_point and line.pull_point_moves]
        self._cables = [(line, actuators.first_coordinate[actuators.names.index(line.name)]) for line in pulled]

    def find(
        self, start: State, position: np.ndarray, forces: ForcesOnBase, solution: StepSolution, carried: CarriedBodies
    ) -> np.ndarray:
        """Force [mN], and torque about the pivot [mN mm], in world axes, in the step from a state, shape (2, 3).

        Args:
            start: state at the start of the step, with the base where it is at the end.
            position: node positions at the end of the step [mm], shape (node_count, 3).
            forces: forces of the soft bodies on the base.
            solution: efforts of the actuators, and impulses on the rigid bodies.
            carried: the rigid bodies that the base carries, where they are at the end of the step.
        """
        pivot = self._model.base_pivot + start.base_translation
        arm = moved_with_base(start.anchor_position, start, self._model.base_pivot) - pivot
        wrench = _resultant(arm, forces.at_anchors) + _resultant(
            start.position[self._reduced_nodes] - pivot, forces.of_reduced
        )
        for line, coordinate in self._cables:
            wrench += self._pull(line, start, float(solution.effort[coordinate]), pivot)
        for impulse, centre in zip(solution.rigid_impulse[carried.index], carried.position, strict=True):
            force, torque = np.split(impulse / self._model.scene.time.step, 2)
            wrench += [force, torque + np.cross(centre - pivot, force)]
        return wrench

    def _pull(self, line: Line, start: State, tension: float, pivot: np.ndarray) -> np.ndarray:
        """What a cable exerts on the base at its pull point, where it runs at the start of the step."""
        first, second = line.points(start, self._model.base_pivot)[:2]
        force = tension * (second - first) / np.linalg.norm(second - first)
        return np.array([force, np.cross(first - pivot, force)])


def _resultant(arm: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Sums of forces and of their torques, shape (2, 3), from arms and forces, shape (count, 3) each."""
    return np.array([force.sum(axis=0), np.cross(arm, force).sum(axis=0)])
