"""A controller that follows keys, with the bindings of SOFA's pneunet gripper tutorial."""

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from taichisoft.bodies.rotations import right_of
from taichisoft.control.control import Control
from taichisoft.control.controller import Controller, Slider
from taichisoft.control.keys import KeyEvent
from taichisoft.control.observation import Observation
from taichisoft.scenes.table import Positive
from taichisoft_controllers.drives import PRESSURE, PULL, TENSION, Drive
from taichisoft_controllers.model_names import finger_of
from taichisoft_controllers.settings import ControllerSettings

if TYPE_CHECKING:
    from taichisoft.bodies.cables import Cable
    from taichisoft.model import Model
    from taichisoft.scenes.scene import Limits

LOWEST_PRESSURE, HIGHEST_PRESSURE = 0.0, 150.0
"""Range of the pressures where the scene's limits give none [kPa]."""
HIGHEST_PULL = 1.0 / 3.0
"""Share of its length by which a cable is pulled in where the scene gives it no stop [-]."""
HIGHEST_TENSION = 10000.0
"""Tension of a cable to which the scene gives no highest one [mN]."""

# On many keyboards "=" is "+" without shift.
EFFORT_KEYS = {"+": 1.0, "=": 1.0, "-": -1.0}
TURN_KEYS = {"a": 1, "q": -1}
# Numbers of steps to the right and upwards, in the gripper's own frame.
MOVE_KEYS = {"up": (0.0, 1.0), "down": (0.0, -1.0), "left": (-1.0, 0.0), "right": (1.0, 0.0)}


class KeyboardSettings(ControllerSettings):
    """Settings of the controller "keyboard"."""

    pressure_step: Positive = 1.0
    """Change of the pressure by one key press [kPa]."""
    cables: Literal["pull", "tension"] = "pull"
    """What keys and sliders change of cables: how far they are pulled in, or their tension."""
    pull_step: Positive = 1.0
    """Length by which one key press pulls the cables in or pays them out [mm]."""
    tension_step: Positive = 100.0
    """Change of the cables' tension by one key press [mN]."""
    translation_step: Positive = 3.0
    """Way of the base by one key press [mm]."""
    turn_step: Positive = 11.25
    """Turn of the base by one key press [degrees]."""


class KeyboardController(Controller):
    """Closes, moves and turns the gripper as keys say; each key press is one step, held keys repeat.

    Up is against gravity. Right is the next coordinate axis after up (y where up is x, x where up is z), made
    perpendicular to it, as in the pictures; left and right turn with the gripper. (In SOFA's tutorial, whose camera
    stands on the other side, left is +y.) "a" turns it about the upward axis by the right-hand rule: anticlockwise
    for who looks down on it.

    What it asks for depends on the keys alone. Motion is not smoothed here: `limits.base_speed`,
    `limits.pressure_rate` and `limits.pull_speed` of the scene spread a step over time.

    Attributes:
        status: finger whose pressure, or pull, + and - change.
        sliders: pressure of every cavity and pull, or tension, of every cable, by its name.
    """

    interactive = True
    sliders: dict[str, Slider]

    def __init__(self, **settings: Any):
        """Take the settings that `KeyboardSettings` describes.

        Raises:
            SceneError: one of them is not valid.
        """
        self._steps = KeyboardSettings.checked(**settings)
        self._cable_drive = PULL if self._steps.cables == PULL.name else TENSION
        self._drives: dict[str, Drive] = {}
        self.bindings = self._bindings()

    def reset(self, model: "Model") -> None:
        """Begin with all pressures and pulls 0, or as near as limits allow, at the base's rest, all fingers selected.

        A finger is a soft body with cavities or cables; they are numbered in the order of the scene.
        """
        steps, drive = self._steps, self._cable_drive
        pressure = _slider(*_pressure_range(model.scene.limits), steps.pressure_step, PRESSURE)
        self.sliders = dict.fromkeys(model.cavities.names, pressure)
        self._drives = dict.fromkeys(model.cavities.names, PRESSURE) | dict.fromkeys(model.cables.names, drive)
        for cable in model.cables.all:
            lowest, highest = _pull_range(cable) if drive is PULL else _tension_range(cable)
            step = steps.pull_step if drive is PULL else steps.tension_step
            self.sliders[cable.name] = _slider(lowest, highest, step, drive)
        driven = {finger_of(name) for name in self.sliders}
        self._fingers = [name for name in model.scene.soft_bodies if name in driven]
        self.bindings = self._bindings()
        self._select(None)
        self._up = model.scene.up
        self._right = right_of(self._up)
        self._translation = np.zeros(3)
        self._turns = 0

    def key(self, event: KeyEvent) -> None:
        """Take a step, with or without Ctrl and shift, or move a slider."""
        if event.value is not None:
            if event.key in self.sliders:
                self.sliders[event.key] = _moved(self.sliders[event.key], event.value)
            return
        key = event.key.lower()
        if key in EFFORT_KEYS:
            self._change_effort(EFFORT_KEYS[key])
        elif key in MOVE_KEYS:
            self._move(*MOVE_KEYS[key])
        elif key in TURN_KEYS:
            self._turns += TURN_KEYS[key]
        elif key == "0":
            self._select(None)
        elif key.isdecimal() and int(key) <= len(self._fingers):
            self._select(self._fingers[int(key) - 1])

    def control(self, observation: Observation) -> Control:
        """The sum of the steps by all keys so far."""
        asked: dict[str, dict[str, float]] = {drive.asked: {} for drive in (PRESSURE, self._cable_drive)}
        for name, slider in self.sliders.items():
            asked[self._drives[name].asked][name] = slider.value
        return Control(
            pressure=asked.pop(PRESSURE.asked),
            base_translation=self._translation.copy(),
            base_rotation=self._turn * self._up,
            **asked,  # type: ignore[arg-type] # one of the cables' two
        )

    @property
    def _turn(self) -> float:
        """The angle by which the gripper is turned about the upward axis [rad]."""
        return math.radians(self._turns * self._steps.turn_step)

    def _bindings(self) -> dict[str, str]:
        """What each key does; without a model as if there were cavities alone."""
        steps, drives = self._steps, set(self._drives.values()) or {PRESSURE}
        effects = {
            PRESSURE: ("raise the pressure", "lower the pressure", f"{steps.pressure_step:g} kPa"),
            PULL: ("pull the cables in", "pay the cables out", f"{steps.pull_step:g} mm"),
            TENSION: ("raise the tension", "lower the tension", f"{steps.tension_step:g} mN"),
        }
        driven = {drive: effect for drive, effect in effects.items() if drive in drives}
        quantity = " and ".join(drive.name for drive in driven)
        move, turn = f"by {steps.translation_step:g} mm", f"by {steps.turn_step:g} degrees"
        return {
            "+": ", ".join(f"{more} by {step}" for more, _, step in driven.values()),
            "-": ", ".join(f"{less} by {step}" for _, less, step in driven.values()),
            "up": f"move up {move}",
            "down": f"move down {move}",
            "left": f"move left {move}",
            "right": f"move right {move}",
            "a": f"turn left {turn}",
            "q": f"turn right {turn}",
            "1 2 3 ...": f"select one finger, whose {quantity} + and - change",
            "0": "select all fingers",
        }

    def _select(self, finger: str | None) -> None:
        """Let + and - change the pressure and the pull of one finger, or of all of them."""
        self._selected = finger
        self.status = f"{finger or 'all fingers'} selected"

    def _change_effort(self, steps: float) -> None:
        for name, slider in self.sliders.items():
            if self._selected in (None, finger_of(name)):
                self.sliders[name] = _moved(slider, slider.value + steps * slider.step)

    def _move(self, to_the_right: float, upward: float) -> None:
        right = math.cos(self._turn) * self._right + math.sin(self._turn) * np.cross(self._up, self._right)
        self._translation += self._steps.translation_step * (to_the_right * right + upward * self._up)


def _pressure_range(limits: "Limits") -> tuple[float, float]:
    """Lowest and highest pressure [kPa]."""
    lowest, highest = limits.lowest_pressure, limits.highest_pressure
    return LOWEST_PRESSURE if lowest is None else lowest, HIGHEST_PRESSURE if highest is None else highest


def _pull_range(cable: "Cable") -> tuple[float, float]:
    """How far a cable is paid out and pulled in at most [mm]."""
    return _range(cable.settings.lowest_pull, cable.settings.highest_pull, HIGHEST_PULL * cable.rest_length, cable)


def _tension_range(cable: "Cable") -> tuple[float, float]:
    """Smallest and largest tension [mN]."""
    return _range(cable.settings.lowest_tension, cable.settings.highest_tension, HIGHEST_TENSION, cable)


def _range(lowest: float | None, highest: float | None, furthest: float, cable: "Cable") -> tuple[float, float]:
    """The range that a cable's own limits give; where they leave it open from 0, or for a rod both ways."""
    low = (-furthest if cable.settings.rod else 0.0) if lowest is None else lowest
    high = furthest if highest is None else highest
    return min(low, high), max(low, high)


def _slider(lowest: float, highest: float, step: float, drive: Drive) -> Slider:
    """A slider at 0, or as near as its ends allow."""
    return _moved(Slider(lowest, lowest, highest, step, drive.unit), 0.0)


def _moved(slider: Slider, value: float) -> Slider:
    """The slider at another value, or as near as its ends allow."""
    return replace(slider, value=min(max(value, slider.lowest), slider.highest))
