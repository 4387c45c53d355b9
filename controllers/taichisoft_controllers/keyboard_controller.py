"""A controller that follows keys, with the bindings of SOFA's pneunet gripper tutorial."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field, create_model

from taichisoft.base import right_of
from taichisoft.control import Control, Controller, Force, KeyEvent, Observation, Slider
from taichisoft.mechanics import ACTUATOR_KINDS, UNLIMITED, ActuatorKind, Drive, kind_of, network_drives
from taichisoft.scene import BASE, HingeSettings, Positive
from taichisoft_controllers.model_names import finger_of
from taichisoft_controllers.settings import DRIVES, ControllerSettings, driven_by

if TYPE_CHECKING:
    from taichisoft.contact import Model

# On many keyboards "=" is "+" without shift.
EFFORT_KEYS = {"+": 1.0, "=": 1.0, "-": -1.0}
TURN_KEYS = {"a": 1, "q": -1}
FRAME_KEY, PUSH_KEY = "f", "o"
PUSH_TIME = 0.1
"""How long a push lasts [s]."""
# Numbers of steps to the right and upwards, in the gripper's own frame.
MOVE_KEYS = {"up": (0.0, 1.0), "down": (0.0, -1.0), "left": (-1.0, 0.0), "right": (1.0, 0.0)}


def _settings_of(kind: ActuatorKind) -> dict[str, Any]:
    """The settings of a kind: the change of each drive by one key press, and which of several drives keys change."""
    fields: dict[str, Any] = {}
    if len(kind.drives) > 1:
        names = tuple(drive.name for drive in kind.drives)
        meaning = f"What keys and sliders change of {kind.plural}: {' or '.join(drive.words for drive in kind.drives)}."
        fields[kind.plural] = Literal[names], Field(names[0], description=meaning)
    for drive in kind.drives:
        meaning = f"Change of the {drive.words} by one key press [{drive.unit}]."
        fields[f"{drive.name}_step"] = Positive, Field(drive.step, description=meaning)
    return fields


ActuatorSteps: Any = create_model(
    "ActuatorSteps",
    __base__=ControllerSettings,
    **{key: field for kind in ACTUATOR_KINDS for key, field in _settings_of(kind).items()},
)
"""Settings of all kinds: pressure_step [kPa]; pull_step [mm], tension_step [mN], and cables, "pull" or "tension"."""


class KeyboardSettings(ActuatorSteps):  # type: ignore[misc] # a table with the keys of the kinds
    """Settings of the controller "keyboard"."""

    translation_step: Positive = 3.0
    """Way of the base, or of the frame that keys move, by one key press [mm]."""
    turn_step: Positive = 11.25
    """Turn of it by one key press [degrees]."""
    push: Positive = 200.0
    """Force on the object by one key press, to the right for 0.1 s [mN]."""


@dataclass
class KeyedPose:
    """Where keys have led a frame: its translation [mm], shape (3,), and turns about the upward axis."""

    translation: np.ndarray
    turns: int = 0


class KeyboardController(Controller):
    """Closes, moves and turns the gripper as keys say; each key press is one step, held keys repeat.

    Up is against gravity. Right is the next coordinate axis after up (y where up is x, x where up is z), made
    perpendicular to it, as in the pictures; left and right turn with the gripper. (In SOFA's tutorial, whose camera
    stands on the other side, left is +y.) "a" turns it about the upward axis by the right-hand rule: anticlockwise
    as seen from above.

    "f" lets these keys move another frame: the base, then those of the scene one by one. A frame with a hinge
    turns about that by "a" and "q", and has a slider. "o" pushes the object to the right, as seen from the gripper.

    What it asks for depends on the keys alone. Motion is not smoothed here: `limits.base_speed`,
    `limits.pressure_rate` and `limits.pull_speed` of the scene spread a step over time.

    Attributes:
        status: finger whose pressure, or pull, + and - change, and the frame that keys move.
        sliders: pressure of every cavity, pull, or tension, of every cable, what drives every valve and regulator of
            the air network, and angle of every hinge, by its name.
    """

    interactive = True
    sliders: dict[str, Slider]
    moved_otherwise: Collection[str] = ()
    """Frames that keys leave alone."""

    def __init__(self, **settings: Any):
        """Take the settings that `KeyboardSettings` describes."""
        self._steps = KeyboardSettings.checked(**settings)
        self._chosen = [_chosen(kind, self._steps) for kind in ACTUATOR_KINDS]
        self._drives: dict[str, Drive] = {}
        self._poses = {BASE: KeyedPose(np.zeros(3))}
        self._hinges: list[str] = []
        self._frames: tuple[str, ...] = (BASE,)
        self._frame = BASE
        self._object: str | None = None
        self._pushes = False
        self.bindings = self._bindings()

    def reset(self, model: "Model") -> None:
        """Begin with all pressures and pulls 0, or as near as limits allow, at the base's rest, all fingers selected.

        Valves of the air network begin at their `opening`.

        A finger is a soft body with actuators; they are numbered in the order of the scene.
        """
        self.sliders, self._drives = {}, {}
        for kind, chosen in zip(ACTUATOR_KINDS, self._chosen, strict=True):
            for number, name in enumerate(model.actuators.names_of(kind)):
                drives = [drive for drive in (chosen, *kind.drives) if name in driven_by(drive, model)]
                for drive in drives[:1]:  # sealed air has none
                    self.sliders[name] = _slider(*_range(drive, number, model), self._step(drive), drive)
                    self._drives[name] = drive
        for number, (name, drive) in enumerate(network_drives(model.scene.air).items()):
            network = model.cavities.network
            low, high = network.drive_range[number].tolist()
            slider = _slider(*_within(drive, low, high, model), self._step(drive), drive)
            self.sliders[name] = moved(slider, float(network.start_drive[number]))
            self._drives[name] = drive
        driven = {finger_of(name) for name in self.sliders}
        self._fingers = [name for name in model.scene.soft_bodies if name in driven]
        self.bindings = self._bindings()
        frames = {name: table for name, table in model.scene.frames.items() if table.path is None}
        tables = {name: table for name, table in frames.items() if name not in self.moved_otherwise}
        self._hinges = [name for name, table in tables.items() if table.hinge is not None]
        for name in self._hinges:
            self.sliders[name] = _angle_slider(tables[name].hinge, self._steps.turn_step)
        self._poses = {name: KeyedPose(np.zeros(3)) for name in (BASE, *tables) if name not in self._hinges}
        self._frames = (BASE, *tables)
        self._frame = BASE
        self._object, self._pushes = model.scene.main_object, False
        self._push_steps = max(1, round(PUSH_TIME / model.scene.time.step))
        self.bindings = self._bindings()
        self._select(None)
        self._up = model.scene.up
        self._right = right_of(self._up)

    def key(self, event: KeyEvent) -> None:
        """Take a step, with or without Ctrl and shift, or move a slider."""
        if event.value is not None:
            if event.key in self.sliders:
                self.sliders[event.key] = moved(self.sliders[event.key], event.value)
            return
        key = event.key.lower()
        if key in EFFORT_KEYS:
            self._change_effort(EFFORT_KEYS[key])
        elif key in MOVE_KEYS:
            self._move(*MOVE_KEYS[key])
        elif key in TURN_KEYS:
            self._turn_frame(TURN_KEYS[key])
        elif key == FRAME_KEY:
            self._frame = self._frames[(self._frames.index(self._frame) + 1) % len(self._frames)]
            self._select(self._selected)
        elif key == PUSH_KEY:
            self._pushes = self._object is not None
        elif key == "0":
            self._select(None)
        elif key.isdecimal() and int(key) <= len(self._fingers):
            self._select(self._fingers[int(key) - 1])

    def control(self, observation: Observation) -> Control:
        """The sum of the steps by all keys so far."""
        requests: dict[str, dict[str, float]] = {drive.request: {} for drive in self._drives.values()}
        for name, drive in self._drives.items():
            requests[drive.request][name] = self.sliders[name].value
        others = [name for name in self._poses if name != BASE]
        force = Force(self._steps.push * self._rightward(BASE), steps=self._push_steps)
        pushed, self._pushes = self._pushes, False
        return Control(
            base_translation=self._poses[BASE].translation.copy(),
            base_rotation=self._turn(BASE) * self._up,
            frame_translation={name: self._poses[name].translation.copy() for name in others},
            frame_rotation={name: self._turn(name) * self._up for name in others},
            frame_angle={name: math.radians(self.sliders[name].value) for name in self._hinges},
            forces={str(self._object): force} if pushed else {},
            **requests,  # type: ignore[arg-type] # keys of actuators alone
        )

    def save(self) -> dict[str, Any]:
        """Where keys and sliders have led so far, and which finger is selected."""
        return {
            "sliders": {name: slider.value for name, slider in self.sliders.items()},
            "poses": {name: [pose.translation.tolist(), pose.turns] for name, pose in self._poses.items()},
            "frame": self._frame,
            "selected": self._selected,
        }

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on from there; a slider of another range goes as near as its ends allow."""
        for name, value in saved["sliders"].items():
            self.sliders[name] = moved(self.sliders[name], value)
        self._poses = {name: KeyedPose(np.array(pose[0]), pose[1]) for name, pose in saved["poses"].items()}
        self._frame = saved["frame"]
        self._select(saved["selected"])

    def _turn(self, frame: str) -> float:
        """The angle by which a frame is turned about the upward axis [rad]."""
        return math.radians(self._poses[frame].turns * self._steps.turn_step)

    def _turn_frame(self, steps: int) -> None:
        if self._frame in self._hinges:
            slider = self.sliders[self._frame]
            self.sliders[self._frame] = moved(slider, slider.value + steps * slider.step)
        else:
            self._poses[self._frame].turns += steps

    def _bindings(self) -> dict[str, str]:
        """What each key does; without a model as if there were cavities alone."""
        steps, drives = self._steps, set(self._drives.values()) or set(self._chosen[:1])
        driven = [
            (drive, f"{self._step(drive):g} {drive.unit}".removesuffix(" 1")) for drive in DRIVES if drive in drives
        ]
        quantity = " and ".join(drive.name for drive, _ in driven)
        move, turn = f"by {steps.translation_step:g} mm", f"by {steps.turn_step:g} degrees"
        return {
            "+": ", ".join(f"{drive.more} by {step}" for drive, step in driven),
            "-": ", ".join(f"{drive.less} by {step}" for drive, step in driven),
            "up": f"move up {move}",
            "down": f"move down {move}",
            "left": f"move left {move}",
            "right": f"move right {move}",
            "a": f"turn left {turn}",
            "q": f"turn right {turn}",
            "1 2 3 ...": f"select one finger, whose {quantity} + and - change",
            "0": "select all fingers",
            **({PUSH_KEY: f"push {self._object} to the right by {steps.push:g} mN"} if self._object else {}),
            **({FRAME_KEY: f"let keys move another of {', '.join(self._frames)}"} if len(self._frames) > 1 else {}),
        }

    def _step(self, drive: Drive) -> float:
        """The change by one key press."""
        step: float = getattr(self._steps, f"{drive.name}_step")
        return step

    def _select(self, finger: str | None) -> None:
        """Let + and - change the pressure and the pull of one finger, or of all of them."""
        self._selected = finger
        self.status = f"{finger or 'all fingers'} selected"
        if len(self._frames) > 1:
            self.status += f", keys move {self._frame}"

    def _change_effort(self, steps: float) -> None:
        for name, slider in self.sliders.items():
            if name in self._drives and self._selected in (None, finger_of(name)):
                self.sliders[name] = moved(slider, slider.value + steps * slider.step)

    def _move(self, to_the_right: float, upward: float) -> None:
        if self._frame in self._hinges:
            return
        self._poses[self._frame].translation += self._steps.translation_step * (
            to_the_right * self._rightward(self._frame) + upward * self._up
        )

    def _rightward(self, frame: str) -> np.ndarray:
        """The direction to the right of a frame, which turns with it."""
        turn = self._turn(frame)
        right: np.ndarray = math.cos(turn) * self._right + math.sin(turn) * np.cross(self._up, self._right)
        return right


def _chosen(kind: ActuatorKind, settings: KeyboardSettings) -> Drive:
    """The drive of a kind that keys change where an actuator has it, or else its first."""
    name = getattr(settings, kind.plural, kind.drives[0].name)
    return next(drive for drive in kind.drives if drive.name == name)


def _range(drive: Drive, number: int, model: "Model") -> tuple[float, float]:
    """The range that the limits of an actuator and of the scene give; else from 0, or both ways, to the drive's end."""
    kind = kind_of(drive)
    if drive not in (kind.effort, kind.coordinate):
        return drive.nearest, drive.furthest
    actuators = model.actuators.sets[kind.name]
    low, high = (actuators.effort_range if drive is kind.effort else actuators.coordinate_range)[number].tolist()
    furthest = drive.furthest * (float(actuators.rest_value[number]) if drive.relative else 1.0)
    return _within(drive, low, high, model, furthest, bool(actuators.pushes_and_pulls[number]))


def _within(
    drive: Drive, low: float, high: float, model: "Model", furthest: float = 0.0, both_ways: bool = False
) -> tuple[float, float]:
    """A range within the limits of the scene, with ends where neither has any."""
    limits, furthest = model.scene.limits, furthest or drive.furthest
    given = getattr(limits, f"lowest_{drive.name}", None), getattr(limits, f"highest_{drive.name}", None)
    low = max(low, -UNLIMITED if given[0] is None else given[0])
    high = min(high, UNLIMITED if given[1] is None else given[1])
    low = (-furthest if both_ways else 0.0) if low <= -UNLIMITED else low
    high = furthest if high >= UNLIMITED else high
    return min(low, high), max(low, high)


def _angle_slider(hinge: HingeSettings | None, step: float) -> Slider:
    """A slider for the angle of a hinge [degrees]: between its stops, or half a turn both ways."""
    low, high = (None, None) if hinge is None else (hinge.lowest_angle, hinge.highest_angle)
    return Slider(0.0, -180.0 if low is None else low, 180.0 if high is None else high, step, "degrees")


def _slider(lowest: float, highest: float, step: float, drive: Drive) -> Slider:
    """A slider at 0, or as near as its ends allow."""
    return moved(Slider(lowest, lowest, highest, step, drive.unit), 0.0)


def moved(slider: Slider, value: float) -> Slider:
    """The slider at another value, or as near as its ends allow."""
    return replace(slider, value=min(max(value, slider.lowest), slider.highest))
