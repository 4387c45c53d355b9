"""What a scene's controllers write in a run: the frames that they drive, and the requests of the run."""

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from taichisoft.control import Control
from taichisoft.errors import SceneError
from taichisoft_sofa.components.air_and_cables import VOLUME, is_driven_by_force, value_type
from taichisoft_sofa.components.draft import DraftJoint, DraftMaterial
from taichisoft_sofa.components.known_components import is_without_effect
from taichisoft_sofa.components.reading import STATE, described, mapping_of, present_value
from taichisoft_sofa.components.states import FramePoses, base_frames, bases_of, is_rigid, start_values, width_of
from taichisoft_sofa.loading import SceneTree
from taichisoft_sofa.translation.parts import SoftPart, Translation
from taichisoft_sofa.translation.soft_bodies import add_moduli
from taichisoft_sofa.tree.component import Component, TreeObject
from taichisoft_sofa.tree.data import Data
from taichisoft_sofa.tree.node import Node
from taichisoft_sofa.tree.value_kinds import POINT, canonical
from taichisoft_sofa.tree.value_kinds import numbers as parse_numbers

if TYPE_CHECKING:
    from taichisoft.contact import Model


class JointMotion:
    """Angles of a joint under its springs and Rayleigh damping, by implicit Euler as in SOFA, without other torques.

    Attributes:
        state: mechanical object of the angles.
        angle: angles [rad], shape (count,).
        velocity: angular velocities [rad/s], shape (count,).
    """

    def __init__(self, joint: DraftJoint) -> None:
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
        """Move by a time step [s]."""
        self.take_written()
        solver = self._joint.solver
        if solver is None:
            return
        stiffness, rest = self._joint.stiffness(), self._joint.rest()
        mass = self._joint.mass
        stretched, imposed = rest - self.angle, np.isinf(stiffness)
        stiffness = np.where(imposed, 1.0, stiffness)
        if solver.read_flag("firstOrder"):
            self.velocity = stiffness * stretched / (mass + time_step * stiffness)
        else:
            lag = time_step + solver.read_number("rayleighStiffness", default=0.0)
            drag = mass * solver.read_number("rayleighMass", default=0.0)
            force = stiffness * (stretched - lag * self.velocity) - drag * self.velocity
            inertia = mass + time_step * drag + time_step * lag * stiffness
            self.velocity = self.velocity + time_step * force / inertia
        self.velocity = np.where(imposed, stretched / time_step, self.velocity)
        self.angle = self.angle + time_step * self.velocity


class DrivenFrames:
    """The driven frames of a run."""

    def __init__(self, tree: SceneTree, translation: Translation):
        """Begin at the start of the scene."""
        self._joints = {id(joint.state): JointMotion(joint) for joint in translation.joints}
        self._parts = {name: part for name, part in translation.soft.items() if part.targets}
        self._driven = [component for component in tree.components() if self._is_driven(component)]
        self._poses = FramePoses(start_values)
        self._time = 0.0
        self._sprung, self._frames, self._motions = translation.sprung, translation.driven, translation.motions

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
        for target, nodes, rows, axes in targets:
            positions[np.ix_(nodes, axes)] = target.places(rows, self._time, self._poses)[:, axes]
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
        if state in self._motions:
            return self._motions[state].poses(self._time)
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


# Changes of Young's moduli by a scene's controllers, which take effect at `reinit()`, as in SOFA.

ROUND_OFF = 1e-9
"""Largest difference of equal Young's moduli, relative, and of equal Poisson's ratios [-]."""


class PartStiffness:
    """The force fields of a soft body, whose sum gives the moduli of its native materials."""

    def __init__(self, name: str, part: SoftPart):
        """Store the initial stiffness of the scene.

        Args:
            name: the body's native name.
            part: the body.
        """
        regions = range(part.material.max(initial=0))
        self._names = [name, *(f"{name}.regions.{index}" for index in regions)]
        self._tetrahedra = part.points[part.elements]
        self._material = part.material
        # One element represents its material.
        self._first = np.array([np.argmax(part.material == number) for number in range(len(self._names))])
        self._fields = tuple(part.body.materials)
        self._young, self._poisson = add_moduli(self._tetrahedra, self._fields)

    def begin(self) -> None:
        """Take the requests up to now as the initial state of the scene."""
        for field in self._fields:
            field.component.reinit_requested = False

    def take(self) -> dict[str, float]:
        """The moduli [kPa] that have changed since the last call, by native material."""
        fields = tuple(map(_present_stiffness, self._fields))
        changed = [new for new, old in zip(fields, self._fields, strict=True) if new is not old]
        if not changed:
            return {}
        young, poisson = add_moduli(self._tetrahedra, fields)
        where = described(changed[0].component)
        if np.abs(poisson - self._poisson).max() > ROUND_OFF:
            raise SceneError(
                f"{where}: its new youngModulus changes Poisson's ratio where force fields of other ratios overlap; "
                "give all of them the same poissonRatio"
            )
        if (np.abs(young - young[self._first][self._material]) > ROUND_OFF * np.abs(young)).any():
            raise SceneError(
                f"{where}: its new youngModulus makes tetrahedra of one stiffness differ; give tetrahedra that "
                "will change another youngModulus from the start"
            )
        before = self._young[self._first]
        self._fields, self._young = fields, young
        after = young[self._first]
        return {self._names[number]: float(after[number]) for number in np.flatnonzero(after != before)}


def _present_stiffness(field: DraftMaterial) -> DraftMaterial:
    """A force field with its present moduli; the same object if unchanged."""
    component = field.component
    declared = component.declared_data("youngModulus")
    if declared is None or not declared.live:
        return field
    if not component.reinit_requested and not component.read_flag("updateStiffness"):
        return field
    component.reinit_requested = False
    young = component.read_each("youngModulus", len(field.tetrahedra), "tetrahedra")
    return field if np.array_equal(young, field.young_modulus) else replace(field, young_modulus=young)


STEERING = {"position", "rest_position", "stiffness"}
"""Data of joints, of their springs and of frames that the scene moves, whose changes have an effect."""
SILENT = {"name", "listening", "printLog", "bbox", "animate"}
"""Data whose changes are not expected to move a body."""
APPEARANCE = {"OglModel", "VisualModel", "BackgroundSetting", "OglSceneFrame"}
"""Types whose changes affect pictures only."""


class SceneWrites:
    """Converts writes to the tree to requests of the run."""

    def __init__(self, tree: SceneTree, translation: Translation, model: "Model", driven: DrivenFrames):
        """Find the data that steer the run."""
        self._tree, self._translation, self._driven = tree, translation, driven
        targets = (target for part in translation.soft.values() for target, *_ in part.targets)
        self._steering = {id(source) for target in targets for source in target.sources()}
        bases = (base for frame in translation.driven.values() for base, _ in base_frames(*frame))
        self._steering |= {id(base) for base in bases}
        self._steering |= {id(joint.springs) for joint in translation.joints}
        self.time_step = model.scene.time.step
        kinds = {"SurfacePressureConstraint": model.cavities.names, "CableConstraint": model.cables.names}
        actuators: dict[str, list[tuple[Component, str]]] = {kind: [] for kind in kinds}
        for component, name in translation.names.items():
            if (kind := canonical(component.type_name)) in kinds:
                if name not in kinds[kind]:
                    raise SceneError(f"has a {kind} '{name}' that the run does not have")
                actuators[kind].append((component, name))
        self._cavities, self._cables = actuators.values()
        lengths = dict(zip(model.cables.names, model.cables.rest_value, strict=True))
        self._paid_out = {
            name: cable.read_number("cableInitialLength", default=lengths[name]) - lengths[name]
            for cable, name in self._cables
        }
        self._rest = {name: known_data(part.body.state, "rest_position") for name, part in translation.soft.items()}
        self._held = {name: part.body.position[part.points[part.anchored]] for name, part in translation.soft.items()}
        self._stiffness = [PartStiffness(name, part) for name, part in translation.soft.items() if part.body.materials]
        self._gravity = known_data(tree.root, "gravity")
        self._watched: list[tuple[TreeObject, int]] = []
        self._revisions: dict[int, int] = {}

    def begin(self) -> None:
        """Take all writes up to now as the initial state, but rest positions elsewhere; later writes are changes."""
        for name, data in self._rest.items():
            if not data.is_set() or np.array_equal(data.given(), self._translation.soft[name].body.position):
                data.take()
        self._gravity.take()
        for part in self._stiffness:
            part.begin()
        for cable, _ in self._cables:
            place = cable.findData("pullPoint")
            if place is not None:
                place.take()
        self._reported: set[int] = set()
        self._before: dict[int, float] = {}
        self._watched = [(owner, owner.data_revision) for owner in self._changeable()]
        self._revisions = {
            id(data): data.revision for owner, _ in self._watched for data in owner.data_by_name.values()
        }

    def control(self) -> Control:
        """The request by the writes since the last call."""
        pressure, growth = {}, {}
        for cavity, name in self._cavities:
            value = present_value(cavity)
            if value_type(cavity) == VOLUME:
                growth[name] = self._varied(cavity, value, "maxVolumeGrowthVariation", "volumeGrowth")
            else:
                value = self._varied(cavity, value, "maxPressureVariation", "pressure")
                pressure[name] = self._translation.signs[cavity] * value * self._translation.effort_of_value
        tension, pull, pull_points = {}, dict(self._translation.springs), {}
        for cable, name in self._cables:
            value = present_value(cable)
            if is_driven_by_force(cable):
                tension[name] = value * self._translation.effort_of_value
            else:
                pull[name] = self._varied(cable, value, "maxDispVariation", "displacement") - self._paid_out[name]
            place = cable.findData("pullPoint")
            if place is not None and cable.read_flag("hasPullPoint") and (moved := place.take()) is not None:
                pull_points[name] = parse_numbers(moved)
        self._driven.advance(self.time_step)
        anchors = {}
        for name, data in self._rest.items():
            part, moved = self._translation.soft[name], data.take()
            if moved is not None and len(part.anchored):
                self._held[name] = _targets(part, np.asarray(moved), data)
                anchors[name] = self._held[name]
            if self._driven.anchor_positions(name, self._held[name]):
                anchors[name] = self._held[name].copy()
        young_modulus: dict[str, float] = {}
        for body in self._stiffness:
            young_modulus |= body.take()
        gravity = self._gravity.take()
        translations, rotations = self._driven.frame_poses()
        return Control(
            pressure=pressure,
            volume_growth=growth,
            cable_tension=tension,
            cable_pull=pull,
            pull_points=pull_points,
            anchor_positions=anchors,
            frame_translation=translations,
            frame_rotation=rotations,
            gravity=None if gravity is None else parse_numbers(gravity),
            young_modulus=young_modulus,
        )

    def _varied(self, actuator: Component, value: float, limit: str, quantity: str) -> float:
        """The value, limited to the variation of the quantity that the scene allows.

        SOFA compares with a growth or displacement at the beginning of the last step, not of this one: so it changes by
        the allowed variation every two steps.
        """
        if not actuator.is_given(limit):
            return value
        now = float(parse_numbers(known_data(actuator, quantity).read_value())[0])
        before = self._before.get(id(actuator), 0.0)
        self._before[id(actuator)] = now
        middle, variation = now if quantity == "pressure" else before, actuator.read_number(limit)
        return min(max(value, middle - variation), middle + variation)

    def without_effect(self) -> Iterator[str]:
        """One line for each write and each change of the tree without effect, once."""
        for place, (owner, revision) in enumerate(self._watched):
            if owner.data_revision != revision:
                self._watched[place] = owner, owner.data_revision
                yield from self._unused_writes(owner)
        for item, line in self._tree.root.changes_of_tree():
            if item.type_name not in APPEARANCE and not is_without_effect(item.type_name):
                yield f"{line}, which has no effect in a run"

    def _unused_writes(self, owner: TreeObject) -> Iterator[str]:
        steering = STEERING if id(owner) in self._steering else set()
        acts = not isinstance(owner, Node) or owner is self._tree.root
        for data in owner.data_by_name.values():
            declared = owner.declared_data(data.name)
            known = data.name in steering | SILENT or data.is_own() or id(data) in self._reported
            known |= acts and declared is not None and declared.live
            if not known and data.revision > self._revisions.get(id(data), 0):
                self._reported.add(id(data))
                where = f"{owner.described()} ({data.place})"
                yield f"{where}: the scene writes to '{data.name}', which has no effect in a run"

    def _changeable(self) -> Iterator[TreeObject]:
        yield from self._tree.nodes()
        for component in self._tree.components():
            kind = component.type_name
            if type(component) is Component and kind not in APPEARANCE and not is_without_effect(kind):
                yield component


def known_data(owner: TreeObject, name: str) -> Data:
    """A data that exists in every owner of its type."""
    data = owner.findData(name)
    assert data is not None
    return data


def _targets(part: SoftPart, rest: np.ndarray, data: Data) -> np.ndarray:
    """Positions of the anchors: the new rest positions [mm], or unchanged ones for fixed points."""
    if len(rest) != len(part.body.position):
        raise SceneError(f"{data.linkpath}: has {len(rest)} points; {len(part.body.position)} are needed")
    held = part.points[part.anchored]
    return np.asarray(np.where(part.anchored_follows, rest[held], part.body.position[held]))
