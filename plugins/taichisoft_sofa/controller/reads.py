"""Live data for a scene's controllers: positions, velocities, volumes and forces of the present state."""

import functools
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from taichisoft.base import matrices_from_quaternions
from taichisoft.control import Observation
from taichisoft.errors import SceneError
from taichisoft.mechanics import State, embed
from taichisoft_sofa.components.contact import CONSTRAINT_SOLVERS
from taichisoft_sofa.components.reading import STATE, independent_state, inputs_of, mapping_of, node_of
from taichisoft_sofa.components.states import base_frames, composed, index_pairs, is_rigid, relative, start_position
from taichisoft_sofa.controller.writes import DrivenFrames
from taichisoft_sofa.loading import SceneTree
from taichisoft_sofa.translation.parts import SoftPart, Translation
from taichisoft_sofa.translation.rigid_bodies import rigid_parts
from taichisoft_sofa.tree.component import Component
from taichisoft_sofa.tree.data import Data
from taichisoft_sofa.tree.value_kinds import canonical

if TYPE_CHECKING:
    from taichisoft.contact import Model

# Present values of the parts of which a scene puts soft bodies together: free points, and frames of rigid parts.

Points = Callable[[], np.ndarray]
"""Function that returns the present places of all points of a body [mm], shape (point_count, 3)."""


def part_positions(part: "SoftPart", points: Points) -> "Iterator[tuple[Component, Points]]":
    """Mechanical objects of which a body is put together, each with a function that returns its positions.

    Args:
        part: the body.
        points: present places of its points.
    """
    parts = rigid_parts(part.body.state)
    mapping = mapping_of(part.body.state)
    if mapping is None or not parts:
        return
    inputs = inputs_of(mapping)
    pairs = index_pairs(mapping, len(inputs))
    for which, source in enumerate(inputs):
        rows = np.full(len(start_position(source)), -1)
        rows[pairs[pairs[:, 0] == which, 1]] = np.flatnonzero(pairs[:, 0] == which)
        if (rows >= 0).all():
            yield source, _rows(points, rows)
    frames: dict[int, tuple[Component, dict[int, np.ndarray]]] = {}
    for rigid in parts:
        for base, index in base_frames(rigid.state, rigid.index):
            if mapping_of(base) is None and is_rigid(base) and index is not None:
                frames.setdefault(id(base), (base, {}))[1][index] = rigid.points
    for base, by_index in frames.values():
        yield base, _frames(points, part.body.position, start_position(base), by_index)


def _rows(points: Points, rows: np.ndarray) -> Points:
    return lambda: points()[rows]


def _frames(points: Points, start: np.ndarray, poses: np.ndarray, by_index: dict[int, np.ndarray]) -> Points:
    def present() -> np.ndarray:
        moved, now = poses.copy(), points()
        for index, own in by_index.items():
            moved[index] = moved_pose(poses[index], start[own], now[own])
        return moved

    return present


def moved_pose(pose: np.ndarray, start: np.ndarray, now: np.ndarray) -> np.ndarray:
    """Pose (7,) of a frame that moves as points do that keep their shape, shapes (count, 3), in least squares."""
    turn, _ = Rotation.align_vectors(now - now.mean(axis=0), start - start.mean(axis=0))
    before = np.array([[*start.mean(axis=0), 0.0, 0.0, 0.0, 1.0]])
    after = np.array([[*now.mean(axis=0), *turn.as_quat()]])
    found: np.ndarray = composed(after, relative(before, pose[None]))[0]
    return found


class RunValues:
    """Provides the data of a scene's components with their values in a run."""

    def __init__(self, tree: SceneTree, translation: Translation, model: "Model", driven: DrivenFrames):
        """Register as the provider of the tree's data."""
        self._observation: Observation | None = None
        self._provided: list[tuple[Data, Callable[[], Any]]] = []
        self._effort_of_value = translation.effort_of_value
        self._names = translation.names
        self._has_friction = model.scene.contact.friction > 0.0
        soft = {body.name: body for body in model.soft_bodies}
        rigid = {body.name: number for number, body in enumerate(model.rigid_bodies)}
        missing = [name for name in translation.soft if name not in soft]
        if missing:
            raise SceneError(f"has a body '{missing[0]}' that the run does not have")
        self._provide(tree.root.findData("time"), lambda: self._seen.time)
        for joint in driven.joints:
            self._provide(joint.state.findData("position"), partial(lambda joint: joint.angle[:, None], joint))
            self._provide(joint.state.findData("velocity"), partial(lambda joint: joint.velocity[:, None], joint))
        for frames in driven.frames:
            self._provide(frames.findData("position"), partial(driven.poses, frames))
        for component in tree.components():
            kind = canonical(component.type_name)
            if kind == STATE:
                self._provide_state(component, translation, soft, rigid)
            elif kind in CONSTRAINT_SOLVERS:
                self._provide(component.findData("constraintForces"), self._contact_impulses)
            elif kind == "SurfacePressureConstraint" and component in translation.names:
                self._provide_cavity(component, model)
            elif kind == "CableConstraint" and component in translation.names:
                self._provide_cable(component, model)

        for name, part in translation.soft.items():
            self._provide_parts(part, soft[name].nodes)

    def observe(self, observation: Observation) -> None:
        """Provide the values of this observation from now on."""
        self._observation = observation
        for data, value in self._provided:
            data.provider = value
            data.take()  # discard what the scene wrote: the data shows the run's value again

    @property
    def _seen(self) -> Observation:
        assert self._observation is not None  # data are not read before the first step
        return self._observation

    @property
    def _state(self) -> State:
        state = self._seen.state
        if state is None:
            raise SceneError("the observation has no state, which a SOFA scene needs")
        return state

    def _provide(self, data: Data | None, value: Callable[[], Any]) -> None:
        """Provide a data with a value, once there is an observation."""
        if data is not None:
            self._provided.append((data, value))

    def _provide_state(
        self, state: Component, translation: Translation, soft: dict[str, Any], rigid: dict[str, int]
    ) -> None:
        self._provide(state.findData("force"), lambda: _no_force(state))
        body = independent_state(node_of(state))
        name = translation.names.get(body) if body is not None else None
        if name in translation.soft:
            part, nodes = translation.soft[name], soft[name].nodes
            fixed = start_position(state)
            carriers = functools.cache(lambda: _carriers(state, part))  # computed on demand, since most are never read

            def points(values: np.ndarray, otherwise: np.ndarray) -> np.ndarray:
                own, weights = carriers()
                moved = np.einsum("pk,pkd->pd", weights, values[nodes][own])
                return np.where(np.any(weights, axis=1, keepdims=True), moved, otherwise)

            self._provide(state.findData("position"), lambda: points(self._state.position, fixed))
            self._provide(state.findData("velocity"), lambda: points(self._state.velocity, np.zeros_like(fixed)))
        elif name in rigid and name is not None:
            number = rigid[name]
            if mapping_of(state) is None:
                point, turning = (7, 6) if is_rigid(state) else (3, 3)
                self._provide(state.findData("position"), lambda: _pose(self._state, number)[:, :point])
                self._provide(state.findData("velocity"), lambda: _twist(self._state, number)[:, :turning])
            else:
                local = start_position(state)[:, :3]
                self._provide(state.findData("position"), lambda: _carried(self._state, number, local))

    def _provide_parts(self, part: SoftPart, nodes: slice) -> None:
        """Provide the mechanical objects of which the scene puts a body together."""

        def points() -> np.ndarray:
            present = part.body.position[:, :3].copy()
            present[part.points] = self._state.position[nodes]
            return present

        for state, positions in part_positions(part, points):
            if all(state is not driven for target, _, _ in part.targets for driven in target.sources()):
                self._provide(state.findData("position"), positions)

    def _contact_impulses(self) -> np.ndarray:
        """Impulse of each contact, along its normal and, with friction, along two tangents [mN s], flattened."""
        state = self._state
        normal, impulse = state.contact_normal, state.contact_impulse
        along = np.einsum("cd,cd->c", impulse, normal)
        if not self._has_friction:
            return along
        axis = np.where(np.abs(normal[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
        first = np.cross(normal, axis)
        first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-300)
        tangents = (first, np.cross(normal, first))
        return np.column_stack([along, *(np.einsum("cd,cd->c", impulse, one) for one in tangents)]).ravel()

    def _provide_cavity(self, cavity: Component, model: "Model") -> None:
        name = self._names[cavity]
        rest = float(model.cavities.rest_value[model.cavities.names.index(name)])
        for data, value in {
            "cavityVolume": lambda: self._seen.volumes[name],
            "initialCavityVolume": lambda: rest,
            "volumeGrowth": lambda: self._seen.volumes[name] - rest,
            "pressure": lambda: self._seen.pressures[name] / self._effort_of_value,
        }.items():
            self._provide(cavity.findData(data), value)

    def _provide_cable(self, cable: Component, model: "Model") -> None:
        name = self._names[cable]
        rest = float(model.cables.rest_value[model.cables.names.index(name)])
        for data, value in {
            "cableLength": lambda: self._seen.cable_lengths[name],
            "cableInitialLength": lambda: rest,
            "displacement": lambda: rest - self._seen.cable_lengths[name],
            "force": lambda: self._seen.cable_tensions[name] / self._effort_of_value,
        }.items():
            self._provide(cable.findData(data), value)


def _no_force(state: Component) -> np.ndarray:
    """Refuse to read a force, which is not computed; an empty array would be misleading."""
    raise state.refused("force is not known in a run; cables have force, cavities have pressure")


def _carriers(state: Component, part: SoftPart) -> tuple[np.ndarray, np.ndarray]:
    """Native nodes that carry the points of a mechanical object, and their weights, 0 for points without nodes."""
    points = start_position(state)
    if mapping_of(state) is None or state is part.body.state:
        place = np.full(len(points), -1)
        place[part.points] = np.arange(len(part.points))
        return np.maximum(place, 0)[:, None], (place >= 0).astype(np.float64)[:, None]
    nodes, weights = embed(points, part.body.position[part.points], part.elements)
    return nodes, weights


def _pose(state: State, number: int) -> np.ndarray:
    w, x, y, z = state.rigid_rotation[number]
    return np.array([[*state.rigid_position[number], x, y, z, w]])


def _twist(state: State, number: int) -> np.ndarray:
    return np.array([[*state.rigid_velocity[number], *state.rigid_angular_velocity[number]]])


def _carried(state: State, number: int, local: np.ndarray) -> np.ndarray:
    turn = matrices_from_quaternions(state.rigid_rotation[number : number + 1])[0]
    return state.rigid_position[number] + local @ turn.T
