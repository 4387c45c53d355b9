"""A controller that follows keys, with the bindings of SOFA's pneunet gripper tutorial."""

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.bodies.rotations import right_of
from taichisoft.control.control import Control
from taichisoft.control.controller import Controller, Slider
from taichisoft.control.keys import KeyEvent
from taichisoft.control.observation import Observation
from taichisoft.scenes.scene import Positive
from taichisoft_controllers.model_names import finger_of
from taichisoft_controllers.settings import ControllerSettings

if TYPE_CHECKING:
    from taichisoft.model import Model

LOWEST_PRESSURE, HIGHEST_PRESSURE = 0.0, 150.0
"""Range of the pressures where the scene's limits give none [kPa]."""

# On many keyboards "=" is "+" without shift.
PRESSURE_KEYS = {"+": 1.0, "=": 1.0, "-": -1.0}
TURN_KEYS = {"a": 1, "q": -1}
# Numbers of steps to the right and upwards, in the gripper's own frame.
MOVE_KEYS = {"up": (0.0, 1.0), "down": (0.0, -1.0), "left": (-1.0, 0.0), "right": (1.0, 0.0)}


class KeyboardSettings(ControllerSettings):
    """Settings of the controller "keyboard"."""

    pressure_step: Positive = 1.0
    """Change of the pressure by one key press [kPa]."""
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

    What it asks for depends on the keys alone. Motion is not smoothed here: `limits.base_speed` and
    `limits.pressure_rate` of the scene spread a step over time.

    Attributes:
        status: finger whose pressure + and - change.
        sliders: pressure of every cavity, by its name.
    """

    interactive = True
    sliders: dict[str, Slider]

    def __init__(self, **settings: Any):
        """Take the settings that `KeyboardSettings` describes.

        Raises:
            SceneError: one of them is not valid.
        """
        self._steps = steps = KeyboardSettings.checked(**settings)
        self.bindings = {
            "+ -": f"raise or lower the pressure by {steps.pressure_step:g} kPa",
            "up down": f"move up or down by {steps.translation_step:g} mm",
            "left right": f"move to the left or right by {steps.translation_step:g} mm",
            "a q": f"turn by {steps.turn_step:g} degrees to the left or right",
            "1 2 3 ...": "select one finger, whose pressure + and - change",
            "0": "select all fingers",
        }

    def reset(self, model: "Model") -> None:
        """Begin with pressures of 0, or as near as the scene's limits allow, at the base's rest, all fingers selected.

        A finger is a soft body with cavities; they are numbered in the order of the scene.
        """
        limits = model.scene.limits
        lowest = LOWEST_PRESSURE if limits.lowest_pressure is None else limits.lowest_pressure
        highest = HIGHEST_PRESSURE if limits.highest_pressure is None else limits.highest_pressure
        slider = _moved(Slider(lowest, lowest, highest, self._steps.pressure_step, "kPa"), 0.0)
        self.sliders = dict.fromkeys(model.cavities.names, slider)
        self._fingers = list(dict.fromkeys(finger_of(name) for name in model.cavities.names))
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
        if key in PRESSURE_KEYS:
            self._change_pressure(PRESSURE_KEYS[key] * self._steps.pressure_step)
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
        return Control(
            pressure={name: slider.value for name, slider in self.sliders.items()},
            base_translation=self._translation.copy(),
            base_rotation=self._turn * self._up,
        )

    @property
    def _turn(self) -> float:
        """The angle by which the gripper is turned about the upward axis [rad]."""
        return math.radians(self._turns * self._steps.turn_step)

    def _select(self, finger: str | None) -> None:
        """Let + and - change the pressure of one finger, or of all of them."""
        self._selected = finger
        self.status = f"{finger or 'all fingers'} selected"

    def _change_pressure(self, change: float) -> None:
        for name, slider in self.sliders.items():
            if self._selected in (None, finger_of(name)):
                self.sliders[name] = _moved(slider, slider.value + change)

    def _move(self, to_the_right: float, upward: float) -> None:
        right = math.cos(self._turn) * self._right + math.sin(self._turn) * np.cross(self._up, self._right)
        self._translation += self._steps.translation_step * (to_the_right * right + upward * self._up)


def _moved(slider: Slider, value: float) -> Slider:
    """The slider at another value, or as near as its ends allow."""
    return replace(slider, value=min(max(value, slider.lowest), slider.highest))
