"""A controller that follows keys, with the bindings of SOFA's pneunet gripper tutorial."""

import math
from typing import TYPE_CHECKING

import numpy as np
from pydantic import ValidationError

from taichisoft.control.control import Control
from taichisoft.control.keys import KeyEvent
from taichisoft.control.observation import Observation
from taichisoft.control.slider import Slider
from taichisoft.errors import SceneError
from taichisoft.scenes.scene import Positive, Table
from taichisoft.scenes.validation_errors import first_problem

if TYPE_CHECKING:
    from taichisoft.model import Model

LOWEST_PRESSURE, HIGHEST_PRESSURE = 0.0, 150.0
"""Where the scene's limits say nothing [kPa]."""

# "=" is where "+" is on many keyboards, without shift.
PRESSURE_KEYS = {"+": 1.0, "=": 1.0, "-": -1.0}
TURN_KEYS = {"a": 1, "q": -1}
# Steps along (right, up), in the gripper's own frame.
MOVE_KEYS = {"up": (0.0, 1.0), "down": (0.0, -1.0), "left": (-1.0, 0.0), "right": (1.0, 0.0)}


class Settings(Table):
    """What a scene's `controller.settings` may say."""

    pressure_step: Positive
    translation_step: Positive
    turn_step: Positive


class KeyboardController:
    """Closes, moves and turns the gripper as keys say; each key press is one step, held keys repeat.

    Up is against gravity. Right is the next coordinate axis after up (y where up is x, x where up is z), made
    perpendicular to it, as in the pictures; left and right turn with the gripper. (In SOFA's tutorial, whose camera
    stands on the other side, left is +y.) "a" turns it about the upward axis by the right-hand rule: anticlockwise
    for who looks down on it.

    What it asks for depends on the keys alone. Motion is not smoothed here: `limits.base_speed` and
    `limits.pressure_rate` of the scene spread a step over time.

    Attributes:
        interactive: a run goes on at the speed of real time until somebody ends it.
        bindings: what the keys do.
        status: which finger is selected, for displays.
        sliders: pressures that can be set at once.
    """

    interactive = True

    def __init__(self, pressure_step: float = 1.0, translation_step: float = 3.0, turn_step: float = 11.25):
        """Set how far one key press goes.

        Args:
            pressure_step: [kPa].
            translation_step: [mm].
            turn_step: [degrees].

        Raises:
            SceneError: a step is not a positive number.
        """
        try:
            steps = {"pressure_step": pressure_step, "translation_step": translation_step, "turn_step": turn_step}
            Settings.model_validate(steps)
        except ValidationError as error:
            raise SceneError(first_problem(error, Settings, "controller.settings")) from error
        self._pressure_step = pressure_step
        self._translation_step = translation_step
        self._turn_step = turn_step
        self.bindings = {
            "+ -": f"raise or lower the pressure by {pressure_step:g} kPa",
            "up down": f"move up or down by {translation_step:g} mm",
            "left right": f"move to the left or right by {translation_step:g} mm",
            "a q": f"turn by {turn_step:g} degrees to the left or right",
            "1 2 3 ...": "select one finger, whose pressure + and - change",
            "0": "select all fingers",
        }

    def reset(self, model: "Model") -> None:
        """Begin with pressures of 0, or as near as the scene's limits allow, at the base's rest, all fingers selected.

        A finger is a soft body with cavities; they are numbered in the order of the scene.
        """
        limits = model.scene.limits
        self._lowest = LOWEST_PRESSURE if limits.lowest_pressure is None else limits.lowest_pressure
        self._highest = HIGHEST_PRESSURE if limits.highest_pressure is None else limits.highest_pressure
        self._pressure = dict.fromkeys(model.cavities.names, self._within_limits(0.0))
        self._fingers = list(dict.fromkeys(_finger_of(name) for name in model.cavities.names))
        self._selected: str | None = None
        self._right, self._up = _right_and_up(np.array(model.scene.gravity))
        self._translation = np.zeros(3)
        self._turns = 0

    def key(self, event: KeyEvent) -> None:
        """Take a step; Ctrl or not is the same, and so is a letter with or without shift. Or move a slider."""
        if event.value is not None:
            if event.key in self._pressure:
                self._pressure[event.key] = self._within_limits(event.value)
            return
        key = event.key.lower()
        if key in PRESSURE_KEYS:
            self._change_pressure(PRESSURE_KEYS[key] * self._pressure_step)
        elif key in MOVE_KEYS:
            self._move(*MOVE_KEYS[key])
        elif key in TURN_KEYS:
            self._turns += TURN_KEYS[key]
        elif key == "0":
            self._selected = None
        elif key.isdecimal() and int(key) <= len(self._fingers):
            self._selected = self._fingers[int(key) - 1]

    def control(self, observation: Observation) -> Control:
        """All that the keys have added up to."""
        return Control(
            pressure=dict(self._pressure),
            base_translation=self._translation.copy(),
            base_rotation=self._turn * self._up,
        )

    @property
    def status(self) -> str:
        """Which finger + and - act on."""
        return f"{self._selected or 'all fingers'} selected"

    @property
    def sliders(self) -> dict[str, Slider]:
        """The pressure of every cavity, by its name."""
        lowest, highest, step = self._lowest, self._highest, self._pressure_step
        return {name: Slider(value, lowest, highest, step, "kPa") for name, value in self._pressure.items()}

    @property
    def _turn(self) -> float:
        """About the upward axis [rad]."""
        return math.radians(self._turns * self._turn_step)

    def _change_pressure(self, change: float) -> None:
        for name, pressure in self._pressure.items():
            if self._selected in (None, _finger_of(name)):
                self._pressure[name] = self._within_limits(pressure + change)

    def _within_limits(self, pressure: float) -> float:
        return min(max(pressure, self._lowest), self._highest)

    def _move(self, to_the_right: float, upward: float) -> None:
        right = math.cos(self._turn) * self._right + math.sin(self._turn) * np.cross(self._up, self._right)
        self._translation += self._translation_step * (to_the_right * right + upward * self._up)


def _finger_of(cavity: str) -> str:
    """Name of the soft body of a cavity "finger1.cavity"."""
    return cavity.partition(".")[0]


def _right_and_up(gravity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors, shape (3,), perpendicular to each other; up is z where there is no gravity."""
    strength = np.linalg.norm(gravity)
    up = -gravity / strength if strength > 0.0 else np.array([0.0, 0.0, 1.0])
    axis = np.roll(np.eye(3)[np.argmax(np.abs(up))], 1)
    right = axis - up * (axis @ up)
    return right / np.linalg.norm(right), up
