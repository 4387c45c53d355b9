"""Mechanical objects: positions at the start, frames that follow others, and what follows frames."""

import contextlib
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from taichisoft.errors import SceneError
from taichisoft_sofa.components.meshes import multiply_quaternions, placed, quaternion
from taichisoft_sofa.components.reading import (
    STATE,
    TOPOLOGIES,
    computed,
    in_node,
    inputs_of,
    linked_state,
    mapping_of,
    mesh_of,
    nearest,
    node_of,
    upwards,
)
from taichisoft_sofa.tree.component import Component
from taichisoft_sofa.tree.value_kinds import canonical

NO_POSE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


WIDTHS = (3, 7)
"""Numbers of a point and of a pose."""


def is_rigid(state: "Component") -> bool:
    """Whether a mechanical object has frames of rigid bodies."""
    return width_of(state) == 7


def width_of(state: "Component") -> int:
    """Numbers per point or frame of a mechanical object; 0 for an unknown template."""
    template = state.read_text("template").partition(",")[0].removeprefix("Cuda")
    if template.startswith("Rigid"):
        return 3 if template.startswith("Rigid2") else 7
    found = re.fullmatch(r"(?:Ext)?Vec(\d+)[dfiu]?", template)
    return int(found[1]) if found else 3 if not template else 0


def keep_start_position(state: "Component") -> None:
    """Keep the positions at the start, as SOFA does when it initialises a scene; later writes do not change them."""
    if not hasattr(state, "_kept"):
        with contextlib.suppress(SceneError):  # refused where it is translated, if that needs it
            state._kept = start_position(state), start_position(state, at_rest=True)


def start_position(state: "Component", at_rest: bool = False) -> np.ndarray:
    """Positions at the start: points, shape (count, 3), or poses (x, y, z, qx, qy, qz, qw), shape (count, 7); `at_rest`
    before `rotation2` and `translation2`, which do not move the rest shape."""
    if hasattr(state, "_kept"):
        kept: np.ndarray = state._kept[at_rest]
        return kept
    width = width_of(state)
    if width not in WIDTHS:
        raise state.refused(f"template '{state.read_text('template')}'; known are Vec3 and Rigid3")
    found = _source(state, width)
    if len(found) == 0 and width == 7:
        found = np.array([NO_POSE])
    scale = state.read_vector("scale3d", default=_axes(state, "s{}"))
    if state.is_given("scale"):
        scale = np.full(3, state.read_number("scale"))
    points, turns = found[:, :3], found[:, 3:]
    for more in ("",) if at_rest else ("", "2"):
        rotation = state.read_vector(f"rotation{more}", default=_axes(state, f"r{{}}{more}"))
        translation = state.read_vector(f"translation{more}", default=_axes(state, f"d{{}}{more}"))
        if (scale != 1.0).any() or rotation.any() or translation.any():
            points = placed(points, scale.tolist(), rotation.tolist(), translation.tolist())
        if width == 7:
            turns = np.array([multiply_quaternions(quaternion(rotation.tolist()), pose) for pose in turns])
        scale = np.ones(3)
    return points if width == 3 else np.column_stack([points, turns])


def _axes(state: "Component", name: str) -> list[float]:
    """Three data of names such as "d{}" in the older format: dx, dy and dz of a translation."""
    return [state.read_number(name.format(axis)) for axis in "xyz"]


def _source(state: "Component", width: int) -> np.ndarray:
    """Source of the positions of a mechanical object: its own data, a link, or its node's topology or loader."""
    for name in ("position", "rest_position"):
        if state.is_given(name):
            found = state.read_numbers(name)
            if found.size % width:
                raise state.refused(f"{name} has {found.size} numbers; they are not rows of {width}")
            if width == 7 or (found.size > 3 and name == "position") or in_node(node_of(state), TOPOLOGIES) is None:
                return found.reshape(-1, width)  # a single point gives way to a topology, as in SOFA
    if width == 7:
        return np.zeros((0, 7))
    if (points := computed(mesh_of(state), "position", 3)).size:
        return points
    if (subset := in_node(node_of(state), {"SubsetMapping"})) is not None and inputs_of(subset):
        whole, chosen = start_position(inputs_of(subset)[0]), subset.read_numbers("indices").astype(np.int64)
        if len(chosen) and chosen.max() >= len(whole):
            raise subset.refused(f"names point {int(chosen.max())}; there are {len(whole)}, from 0 on")
        return whole[chosen]
    if in_node(node_of(state), {"IdentityMapping"}) is not None:
        above = next((nearest(parent, {STATE}) for parent in node_of(state).parents), None)
        if above is not None:
            return start_position(above)
    return np.zeros((0, 3))


def start_velocity(state: "Component") -> np.ndarray:
    """Common initial velocity of all points of a mechanical object: (3,) [mm/s], or (6,) with [rad/s] for a frame."""
    width = 6 if is_rigid(state) else 3
    rows = state.read_numbers("velocity")
    if not rows.any():
        return np.zeros(width)
    rows, count = rows.reshape(-1, width), len(start_position(state))
    if len(rows) != count or not (rows == rows[0]).all():
        raise state.refused(
            f"velocity has {len(rows)} rows, not all alike or not one for each of {count} points; "
            "a body here begins with one velocity of all its points",
        )
    return np.asarray(rows[0])


def state_position(state: "Component", at_rest: bool = False) -> np.ndarray:
    if (width := width_of(state)) not in WIDTHS:  # such a state has no effect here, but its scene may read it
        return np.reshape(state.read_data("position"), (-1, max(width, 1)))
    return start_position(state, at_rest)


def rest_position(state: "Component") -> np.ndarray:
    if state.is_given("rest_position"):
        return np.reshape(state.read_data("rest_position"), (-1, max(width_of(state), 1)))
    return state.read_number("restScale") * state_position(state, at_rest=True)


Values = Callable[["Component"], np.ndarray]
"""Rows of an independent mechanical object: poses (x, y, z, qx, qy, qz, qw) of frames, or angles [rad]."""


def start_values(state: "Component") -> np.ndarray:
    """Rows of an independent mechanical object at the start: poses, shape (count, 7), or angles [rad], (count, 1)."""
    if width_of(state) == 1:
        return np.reshape(state.read_numbers("position", default=[0.0]), (-1, 1))
    return start_position(state)


class FramePoses:
    """FramePoses of the frames of mechanical objects at one moment."""

    def __init__(self, values: Values):
        """Begin without any.

        Args:
            values: the rows of independent mechanical objects at that moment.
        """
        self._values = values
        self._known: dict[int, np.ndarray] = {}

    def of(self, state: "Component") -> np.ndarray:
        """FramePoses of the frames of a mechanical object, shape (frame_count, 7) [mm]."""
        if id(state) not in self._known:
            self._known[id(state)] = self._compute(state)
        return self._known[id(state)]

    def _compute(self, state: "Component") -> np.ndarray:
        mapping = mapping_of(state)
        if mapping is None:
            return self._values(state)
        kind = canonical(mapping.type_name)
        inputs = inputs_of(mapping)
        if kind == "ArticulatedSystemMapping":
            return self._articulated(state, mapping, inputs)
        if kind == "SubsetMultiMapping":
            pairs = index_pairs(mapping, len(inputs))
            return np.array([self._frame(mapping, inputs[which], index) for which, index in pairs]).reshape(-1, 7)
        if kind == "IdentityMapping" and inputs:
            return self.of(inputs[0])
        if kind == "RigidMapping" and inputs:
            local, carriers = start_position(state), rigid_indices(mapping, len(start_position(state)))
            frames = np.array([self._frame(mapping, inputs[0], index) for index in carriers]).reshape(-1, 7)
            if mapping.read_flag("globalToLocalCoords"):
                start = FramePoses(start_values)
                local = relative(np.array([start._frame(mapping, inputs[0], i) for i in carriers]), local)
            return composed(frames, local)
        if not is_rigid(state):  # points that follow a body, whose values are known
            return self._values(state)
        raise mapping.refused(f"frames that follow others by {kind} are not known here")

    def _frame(self, mapping: "Component", state: "Component", index: int) -> np.ndarray:
        frames = self.of(state)
        if not 0 <= index < len(frames):
            raise mapping.refused(f"names frame {index} of {state.getPathName()}, which has {len(frames)}")
        frame: np.ndarray = frames[index]
        return frame

    def _articulated(self, state: "Component", mapping: "Component", inputs: "Sequence[Component]") -> np.ndarray:
        """Frames that joints place one after another, beginning with a frame of `input2` or where the first one is.

        A joint's centre is a point of its parent and of its child; its axes are those of the parent, turned by the
        articulations before.
        """
        poses = start_position(state).copy()
        angles = self._values(inputs[0]).ravel()
        if base := mapping.linked_all("input2"):
            frames = self.of(linked_state(mapping, *base[0]))
            poses[0] = frames[int(mapping.read_number("indexInput2", default=len(frames) - 1))]
        for centre in centres_of(mapping):
            parent, child = (int(centre.read_number(name)) for name in ("parentIndex", "childIndex"))
            if not (0 <= parent < len(poses) and 0 <= child < len(poses)):
                raise centre.refused(f"parentIndex and childIndex must be among {len(poses)} frames")
            turn = Rotation.from_quat(poses[parent, 3:])
            place = poses[parent, :3] + turn.apply(centre.read_vector("posOnParent"))
            for joint in (one for one in node_of(centre).walk_components() if one.type_name == "Articulation"):
                index = int(joint.read_number("articulationIndex"))
                if not 0 <= index < len(angles):
                    raise joint.refused(f"articulationIndex {index}; there are {len(angles)} angles")
                axis = joint.read_vector("rotationAxis")
                axis = axis / (np.linalg.norm(axis) or 1.0)
                if joint.read_flag("rotation"):
                    turn = turn * Rotation.from_rotvec(angles[index] * axis)
                if joint.read_flag("translation"):
                    place = place + turn.apply(angles[index] * axis)
            poses[child, :3] = place - turn.apply(centre.read_vector("posOnChild"))
            poses[child, 3:] = turn.as_quat()
        return poses


def centres_of(mapping: "Component") -> "list[Component]":
    """The ArticulationCenters of the nearest ArticulatedHierarchyContainer, in the order of the tree."""
    for above in upwards(node_of(mapping)):
        if any(one.type_name == "ArticulatedHierarchyContainer" for one in above.objects):
            return [one for one in above.walk_components() if one.type_name == "ArticulationCenter"]
    raise mapping.refused("finds no ArticulatedHierarchyContainer in its node or above")


def index_pairs(mapping: "Component", inputs: int) -> np.ndarray:
    """Input and index in it of each point or frame of a SubsetMultiMapping, shape (count, 2)."""
    pairs = mapping.read_numbers("indexPairs").astype(np.int64)
    if len(pairs) % 2 or (len(pairs) and not 0 <= pairs[::2].min() <= pairs[::2].max() < inputs):
        raise mapping.refused(f"indexPairs must be pairs of one of {inputs} inputs and an index in it")
    return pairs.reshape(-1, 2)


def rigid_indices(mapping: "Component", count: int) -> np.ndarray:
    """The frame that each of `count` points follows by a RigidMapping, shape (count,)."""
    each = mapping.read_numbers("rigidIndexPerPoint").astype(np.int64)
    if len(each) == count:
        return each
    if len(each) and count:
        raise mapping.refused(f"rigidIndexPerPoint has {len(each)} numbers for {count} points")
    return np.full(count, int(mapping.read_number("index")))


def local_position(state: "Component") -> np.ndarray:
    """Positions of points at the start [mm], in the axes of the frames that they follow by a RigidMapping."""
    points, mapping = start_position(state), mapping_of(state)
    if mapping is None or canonical(mapping.type_name) != "RigidMapping" or not inputs_of(mapping):
        return points
    frames, own = FramePoses(start_values).of(inputs_of(mapping)[0]), rigid_indices(mapping, len(points))
    if len(own) and not 0 <= own.min() <= own.max() < len(frames):
        raise mapping.refused(f"names frame {own.max()}; there are {len(frames)}, counted from 0")
    return relative(frames[own], points) if mapping.read_flag("globalToLocalCoords") else points


def frame_carrying(component: "Component") -> "tuple[Component, int] | None":
    """The mechanical object and the index in it of the frame to which a component's node is fixed, or None."""
    node = node_of(component)
    state = nearest(node, {STATE})
    if state is None or is_rigid(state):
        mapping = None if state is None or node is node_of(state) else in_node(node, {"RigidMapping"})
        last = 0 if mapping is None else int(mapping.read_number("index"))
        return None if state is None else (state, last)
    mapping = mapping_of(state)
    if mapping is None or canonical(mapping.type_name) != "RigidMapping":
        return None
    each = np.unique(rigid_indices(mapping, len(start_position(state))))
    if len(each) != 1:
        raise component.refused(f"follows {len(each)} frames; a surface follows one here")
    return inputs_of(mapping)[0], int(each[0])


def composed(frames: np.ndarray, local: np.ndarray) -> np.ndarray:
    """FramePoses (count, 7) of frames given in the axes of others, or places (count, 3) of points in them [mm]."""
    turns = Rotation.from_quat(frames[:, 3:])
    places = turns.apply(local[:, :3]) + frames[:, :3]
    if local.shape[1] == 3:
        return np.asarray(places)
    return np.column_stack([places, (turns * Rotation.from_quat(local[:, 3:])).as_quat()])


def relative(frames: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Inverse of `composed`: poses (count, 7) or points (count, 3) in the axes of frames (count, 7)."""
    back = Rotation.from_quat(frames[:, 3:]).inv()
    places = back.apply(poses[:, :3] - frames[:, :3])
    if poses.shape[1] == 3:
        return np.asarray(places)
    return np.column_stack([places, (back * Rotation.from_quat(poses[:, 3:])).as_quat()])


def base_frames(state: "Component", index: int) -> "list[tuple[Component, int | None]]":
    """The independent mechanical objects that a frame follows, each with the index of its frame or None."""
    mapping = mapping_of(state)
    if mapping is None:
        return [(state, index)]
    kind, above = canonical(mapping.type_name), inputs_of(mapping)
    if kind == "SubsetMultiMapping":
        which, index = index_pairs(mapping, len(above))[index].tolist()
        return base_frames(above[which], index)
    if kind == "RigidMapping":
        return base_frames(above[0], int(rigid_indices(mapping, len(start_position(state)))[index]))
    return [(base, None) for base in bases_of(state)]


def bases_of(state: "Component") -> "list[Component]":
    """The independent mechanical objects that a mechanical object follows, itself if it follows none."""
    mapping = mapping_of(state)
    if mapping is None:
        return [state]
    above = inputs_of(mapping)
    if mapping.read_text("input2"):
        above += [linked_state(mapping, *link) for link in mapping.linked_all("input2")]
    return list({id(base): base for one in above for base in bases_of(one)}.values())


# What anchored points follow: driven frames, the points of another mechanical object, or a motion given in time.


class AnchorTarget(ABC):
    """Places to which points are held."""

    @abstractmethod
    def places(self, rows: np.ndarray, time: float, poses: FramePoses) -> np.ndarray:
        """Places of some of the points [mm], shape (row_count, 3).

        Args:
            rows: numbers of these points among those of the anchor, shape (row_count,).
            time: end of the step [s].
            poses: poses of frames and places of points at that time.
        """

    def sources(self) -> "Sequence[Component]":
        """The mechanical objects whose positions the scene may write to move the target."""
        return []


@dataclass(frozen=True)
class DrivenFrameTarget(AnchorTarget):
    """Points that a driven frame carries: mechanical object and index of it, and their places in its axes [mm]."""

    state: "Component"
    index: int
    local: np.ndarray

    @classmethod
    def carrying(cls, state: "Component", index: int, places: np.ndarray) -> "DrivenFrameTarget":
        """The target of points at these places at the start [mm], shape (count, 3)."""
        frame = FramePoses(start_values).of(state)[[index]]
        return cls(state, index, relative(np.repeat(frame, len(places), axis=0), places))

    def places(self, rows: np.ndarray, time: float, poses: FramePoses) -> np.ndarray:
        return composed(np.repeat(poses.of(self.state)[[self.index]], len(rows), axis=0), self.local[rows])

    def sources(self) -> "Sequence[Component]":
        return [base for base, _ in base_frames(self.state, self.index)]


@dataclass(frozen=True)
class PointsTarget(AnchorTarget):
    """Points of another mechanical object that no body here moves: itself, and their indices, shape (count,)."""

    state: "Component"
    indices: np.ndarray

    def places(self, rows: np.ndarray, time: float, poses: FramePoses) -> np.ndarray:
        return poses.of(self.state)[self.indices[rows], :3]

    def sources(self) -> "Sequence[Component]":
        return [self.state]

    def frame_of(self, row: int) -> "tuple[Component, int]":
        """The mechanical object, and the index in it of a point or frame."""
        return self.state, int(self.indices[row])


@dataclass(frozen=True)
class MotionTarget(AnchorTarget):
    """Points that are shifted in time, linearly from key to key, and stand still before the first and after the last.

    Attributes:
        start: places at the start [mm], shape (count, 3).
        times: times of the keys, rising [s], shape (key_count,).
        shifts: shifts at the keys [mm], shape (key_count, 3).
    """

    start: np.ndarray
    times: np.ndarray
    shifts: np.ndarray

    def places(self, rows: np.ndarray, time: float, poses: FramePoses) -> np.ndarray:
        shift = [np.interp(time, self.times, column) for column in self.shifts.T]
        return self.start[rows] + np.array(shift)


@dataclass(frozen=True)
class FrameMotion:
    """Frames of rigid bodies that are shifted and turned in time, from key to key.

    Attributes:
        start: poses at the start, shape (count, 7).
        times: times of the keys, rising [s], shape (key_count,).
        movements: shifts [mm] and angles about x, y and z [rad] at the keys, shape (key_count, 6).
    """

    start: np.ndarray
    times: np.ndarray
    movements: np.ndarray

    def poses(self, time: float) -> np.ndarray:
        """Poses of all frames, shape (count, 7)."""
        time = float(np.clip(time, self.times[0], self.times[-1]))
        shift = [np.interp(time, self.times, column) for column in self.movements[:, :3].T]
        turns = Rotation.from_euler("xyz", self.movements[:, 3:])
        turn = Slerp(self.times, turns)(time) if len(self.times) > 1 else turns[0]
        own = Rotation.from_quat(self.start[:, 3:]) * turn
        return np.column_stack([self.start[:, :3] + shift, own.as_quat()])
