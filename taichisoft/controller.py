"""What drives a run: the interface of a controller, what it sees and what it may ask for."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from taichisoft.keys import KeyEvent
    from taichisoft.model import Model


@dataclass(frozen=True)
class Control:
    """What a controller asks for; whatever it does not mention stays as it was asked for last.

    The scene's `[limits]` stand between what is asked for and what happens.

    Attributes:
        pressure: [kPa] by cavity name ("finger1.cavity"); a cavity is driven by pressure or by volume.
        volume_growth: [mm^3] over the rest volume, by cavity name; the pressure is then a result.
        base_translation: where all anchors shall go [mm] from their rest positions, shape (3,).
        base_rotation: rotation vector [rad] of all anchors about the scene's base pivot, shape (3,).
        base_velocity: of all anchors [mm/s], shape (3,), until something else is asked for; instead of
            base_translation.
        base_angular_velocity: [rad/s] about the scene's base pivot, in world axes, shape (3,); instead of
            base_rotation.
        signals: numbers of the controller's own by name, such as a set point, for outputs to record.
    """

    pressure: Mapping[str, float] = field(default_factory=dict)
    volume_growth: Mapping[str, float] = field(default_factory=dict)
    base_translation: np.ndarray | None = None
    base_rotation: np.ndarray | None = None
    base_velocity: np.ndarray | None = None
    base_angular_velocity: np.ndarray | None = None
    signals: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Observation:
    """What a controller sees before a step; it depends on the state alone. Arrays are read-only.

    A finger is a soft body with anchors: its tip is what its `tip` in the scene selects. Pairs of bodies are named
    "finger1|cube", in the scene's order; those further apart than `contact.alarm_distance` are left out.

    Attributes:
        time: [s] at the start of the step.
        step: index of the step about to be made.
        pressures: [kPa] of the last step, by cavity name.
        volumes: cavity volumes [mm^3], by cavity name.
        flows: rate of change of each cavity's volume [mm^3/s], by cavity name.
        tip_positions: mean of the tip's nodes [mm], shape (3,), by finger.
        tip_velocities: mean of the tip's nodes [mm/s], shape (3,), by finger.
        bending_angles: by how much the tip has turned against the base [rad], from 0 to pi, by finger.
        base_translation: of all anchors from their rest positions [mm], shape (3,).
        base_rotation: rotation vector of all anchors about the base pivot [rad], shape (3,).
        object_positions: centre of mass [mm] of each rigid body, shape (3,), by name.
        object_rotations: unit quaternion (w, x, y, z) of each rigid body, shape (4,), by name.
        object_velocities: of the centre of mass [mm/s], shape (3,), by name.
        object_angular_velocities: [rad/s] in world axes, shape (3,), by name.
        contact_counts: contacts that press, by pair.
        normal_forces: sum of the normal forces in the last step [mN], by pair.
        friction_forces: sum of the magnitudes of the friction forces in the last step [mN], by pair.
        slip_speeds: fastest sliding of a contact that presses [mm/s], by pair.
        clipped: what of the last request the scene's limits held back: names of cavities, "base_translation" and
            "base_rotation".
    """

    time: float
    step: int
    pressures: Mapping[str, float] = field(default_factory=dict)
    volumes: Mapping[str, float] = field(default_factory=dict)
    flows: Mapping[str, float] = field(default_factory=dict)
    tip_positions: Mapping[str, np.ndarray] = field(default_factory=dict)
    tip_velocities: Mapping[str, np.ndarray] = field(default_factory=dict)
    bending_angles: Mapping[str, float] = field(default_factory=dict)
    base_translation: np.ndarray = field(default_factory=lambda: np.zeros(3))
    base_rotation: np.ndarray = field(default_factory=lambda: np.zeros(3))
    object_positions: Mapping[str, np.ndarray] = field(default_factory=dict)
    object_rotations: Mapping[str, np.ndarray] = field(default_factory=dict)
    object_velocities: Mapping[str, np.ndarray] = field(default_factory=dict)
    object_angular_velocities: Mapping[str, np.ndarray] = field(default_factory=dict)
    contact_counts: Mapping[str, int] = field(default_factory=dict)
    normal_forces: Mapping[str, float] = field(default_factory=dict)
    friction_forces: Mapping[str, float] = field(default_factory=dict)
    slip_speeds: Mapping[str, float] = field(default_factory=dict)
    clipped: tuple[str, ...] = ()


class Controller(Protocol):
    """Anything with these two methods drives a run.

    It may also have:

    - `key(event: KeyEvent) -> None`: called for every key that the run does not use itself, before `control`;
    - `bindings: dict[str, str]`: what its keys do, for the help that `?` shows;
    - `sliders: dict[str, Slider]`: numbers that its user may set, by name, for displays that can show them (see
      `taichisoft.slider.Slider`); one that was moved comes as a `KeyEvent` with that name and its `value`;
    - `interactive = True`: a run goes at the speed of real time and until somebody ends it, unless the user says
      otherwise;
    - `status: str`: what the live status of such a run shows of it, such as which finger is selected;
    - `summary() -> dict[str, str]`: rows for the table that closes a run.

    A controller that cannot do its job raises `taichisoft.errors.ControllerFailed`: the run ends with its outputs
    complete.
    """

    def reset(self, model: "Model") -> None:
        """Called before the first step, and again when a user starts the run anew."""

    def control(self, observation: Observation) -> Control:
        """Called before every step, or every `controller.period` of the scene."""
        ...


class KeyController(Controller, Protocol):
    """A controller that heeds keys."""

    def key(self, event: "KeyEvent") -> None:
        """Called for every key that the run does not use itself."""
