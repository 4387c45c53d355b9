"""Controllers: what they ask for, their sliders, and the keys that they are told of."""

import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

import numpy as np

from taichisoft.control.observation import Observation
from taichisoft.errors import PluginError, nearest

if TYPE_CHECKING:
    from taichisoft.contact.model import Model

# Keys that a user presses while a run goes on, and sliders moved, from whichever device: one stream for all.


@dataclass(frozen=True)
class KeyEvent:
    """A key that was pressed, or repeats because it is held; a slider that was moved; a body that a pointer pulls.

    Attributes:
        key: character that the key types ("a", "+", "?"), or one of "up", "down", "left", "right", "space", "enter",
            "escape", "tab", "backspace"; the name of a slider or of a body.
        ctrl: whether Ctrl was held; most terminals cannot tell for most keys.
        value: number to which a slider was moved; None for a key.
        pointer: place [mm], 3 numbers: the first is picked on the body, later ones pull what was there; none let go.
            None for keys and sliders. The run itself pulls; controllers do not get it.
    """

    key: str
    ctrl: bool = False
    value: float | None = None
    pointer: tuple[float, ...] | None = None

    def __str__(self) -> str:
        """The event as people write it: "Ctrl+a", "finger1.cavity=20", "cube at 1, 2, 3"."""
        if self.pointer is not None:
            return f"{self.key} at {', '.join(f'{one:g}' for one in self.pointer)}"
        if self.value is not None:
            return f"{self.key}={self.value:g}"
        return f"Ctrl+{self.key}" if self.ctrl else self.key


class KeyStream:
    """Keys on their way to a run: any thread puts them in, the run takes them out between two steps."""

    def __init__(self) -> None:
        self._waiting: deque[KeyEvent] = deque()
        self._arrived = threading.Event()

    def put(self, event: KeyEvent) -> None:
        """Add a key; from any thread, never waits."""
        self._waiting.append(event)
        self._arrived.set()

    def take(self) -> list[KeyEvent]:
        """All keys that came since the last call, in their order."""
        self._arrived.clear()
        taken = []
        while self._waiting:
            taken.append(self._waiting.popleft())
        return taken

    def wait(self, seconds: float) -> None:
        """Return when a key is there, or after so many seconds."""
        self._arrived.wait(seconds)


# What a controller asks for.

Vector = np.ndarray | Sequence[float]


class _Request:
    __dataclass_fields__: ClassVar[dict[str, Any]]

    def __new__(cls, *_: Any, **given: Any) -> Self:
        """Refuse an unknown name with the nearest valid one."""
        valid = list(cls.__dataclass_fields__)
        for name in given.keys() - valid:
            raise TypeError(f"{cls.__name__} has no '{name}'; {nearest(name, valid, 'there are')}")
        return super().__new__(cls)


@dataclass(frozen=True)
class Force(_Request):
    """A force from outside on a body or a frame, and a torque.

    Attributes:
        force: [mN], shape (3,).
        torque: about `point` [mN mm], shape (3,); a soft body takes none at a point.
        point: where it acts, as a place at rest [mm], shape (3,), that then moves along; the centre of mass of a rigid
            body and the pivot of a frame unless given. A soft body needs one.
        axes: "world", or "own": axes that turn with what is pushed, and are the world's at rest.
        steps: number of time steps for which it acts; None: until another is asked for.
    """

    force: Vector = (0.0, 0.0, 0.0)
    torque: Vector = (0.0, 0.0, 0.0)
    point: Vector | None = None
    axes: Literal["world", "own"] = "world"
    steps: int | None = None


@dataclass(frozen=True)
class Control(_Request):
    """What a controller asks for; whatever it does not mention stays as it was asked for last.

    The scene's `[limits]` stand between what is asked for and what happens. Angles are in radians.

    Attributes:
        pressure: pressures [kPa] by name of a cavity ("finger1.cavity") or of a regulator in the scene's table `air`; a
            cavity is driven by pressure or by volume.
        volume_growth: volumes over the rest volume [mm^3], by cavity name; the pressure is then a result.
        valve: openings of the valves of air lines, by cavity name, and of those in the table `air`, from 1, wholly open
            to the source, to -1, wholly open to the exhaust.
        cable_tension: tensions [mN] by cable name ("finger1.tendon"); a cable is driven by tension or by pull.
        cable_pull: how far cables are pulled in [mm], by cable name; the tension is then a result.
        pull_points: places of pull points [mm], shape (3,), by cable name; where the scene says so, the motion of a
            frame comes on top.
        base_translation: shift of the base, and so of what is anchored to it or follows it, from rest [mm], shape (3,).
        base_rotation: rotation vector of the base about its pivot [rad], shape (3,).
        base_velocity: velocity of the base [mm/s], shape (3,), until something else is asked for; instead of
            base_translation.
        base_angular_velocity: angular velocity of the base about its pivot, in world axes [rad/s], shape (3,); instead
            of base_rotation.
        frame_translation, frame_rotation, frame_velocity, frame_angular_velocity: the same of the scene's frames [mm],
            [rad], [mm/s] and [rad/s], by name, shape (3,) each, in the axes of the frame that carries it as they are at
            rest. A pose is reached at the end of the step, as far as the frame's speeds allow.
        frame_angle: angles of frames with a hinge [rad], by name.
        anchor_positions: positions that the anchors of a soft body hold their nodes to instead of the rest positions
            [mm], by the body's name, shape (anchor_count, 3): a row for each of its anchored nodes, in the order of the
            nodes. The motion of the frame that the body follows comes on top. No limit of the scene holds them back.
        forces: what pushes and turns from outside, by the name of a soft body, rigid body or frame: one force on each;
            None ends it. What a frame carries feels nothing of a force on it or on a rigid body that follows it: what
            drives the frame holds against it, so that it shows in the frame's wrench.
        gravity: acceleration of gravity [mm/s^2], shape (3,); what is up in pictures remains so.
        young_modulus: Young's moduli [kPa] by material: a soft body's own ("finger1") or one of its regions'
            ("finger1.regions.0"). Poisson's ratios stay.
        signals: numbers of the controller's own by name, such as a set point, for outputs to record.
    """

    pressure: Mapping[str, float] = field(default_factory=dict)
    volume_growth: Mapping[str, float] = field(default_factory=dict)
    valve: Mapping[str, float] = field(default_factory=dict)
    cable_tension: Mapping[str, float] = field(default_factory=dict)
    cable_pull: Mapping[str, float] = field(default_factory=dict)
    pull_points: Mapping[str, Vector] = field(default_factory=dict)
    base_translation: Vector | None = None
    base_rotation: Vector | None = None
    base_velocity: Vector | None = None
    base_angular_velocity: Vector | None = None
    frame_translation: Mapping[str, Vector] = field(default_factory=dict)
    frame_rotation: Mapping[str, Vector] = field(default_factory=dict)
    frame_velocity: Mapping[str, Vector] = field(default_factory=dict)
    frame_angular_velocity: Mapping[str, Vector] = field(default_factory=dict)
    frame_angle: Mapping[str, float] = field(default_factory=dict)
    anchor_positions: Mapping[str, np.ndarray | Sequence[Vector]] = field(default_factory=dict)
    forces: Mapping[str, Force | None] = field(default_factory=dict)
    gravity: Vector | None = None
    young_modulus: Mapping[str, float] = field(default_factory=dict)
    signals: Mapping[str, float] = field(default_factory=dict)


NOTHING = Control()
"""What asks for nothing new."""


# What drives a run: the base class of every controller.


@dataclass(frozen=True)
class Slider:
    """A number that a controller lets its user set at once.

    Attributes:
        value: present value, also after keys that changed it.
        lowest: smallest value that can be set.
        highest: largest value that can be set.
        step: distance between two values that can be set.
        unit: unit of the other four, such as "kPa".
        group: title under which displays show it together with others; "" for the name of the controller.
    """

    value: float
    lowest: float
    highest: float
    step: float
    unit: str
    group: str = ""

    def __post_init__(self) -> None:
        """Check the range."""
        if not (self.lowest <= self.highest and self.step > 0.0):
            raise PluginError(f"{self}: lowest must not be above highest, and step must be above 0")


class Controller(ABC):
    """Base class of everything that drives a run; only `control` must be written.

    A controller that cannot do its job raises `taichisoft.errors.ControllerFailed`: the run ends, and its outputs are
    complete.

    Attributes:
        interactive: whether a person steers: such a run keeps to real time and goes on until somebody ends it, unless
            the user says otherwise.
        bindings: effect of each key that the controller uses, by key, for the help that `?` shows.
        sliders: numbers that a person may set, by name, for displays that can show sliders; one that was moved comes
            to `key` as a `KeyEvent` with that name and its `value`.
        tunable: settings of the controller that a person may change while the run goes on, by name, for displays that
            can show sliders; the values are those that settings have by default. One that was moved makes the
            controller anew, with `save` and `restore`; a controller that does not save has none.
        status: text about the controller for displays, such as which finger is selected.
    """

    interactive: bool = False
    bindings: Mapping[str, str] = MappingProxyType({})
    sliders: Mapping[str, Slider] = MappingProxyType({})
    tunable: Mapping[str, Slider] = MappingProxyType({})
    status: str = ""

    def reset(self, model: "Model") -> None:
        """Prepare for a run: called before the first step, and again when a user starts the run again."""

    def key(self, event: KeyEvent) -> None:
        """Heed a key that the run does not use itself; called before `control`."""

    @abstractmethod
    def control(self, observation: Observation) -> Control:
        """Say what shall happen: called before every step, or every `controller.period` of the scene."""

    def save(self) -> dict[str, Any] | None:
        """Everything that the controller remembers from one `control` to the next, so that a run can go on from here.

        Called after `reset`, before the first step, and after every step that is recorded. The values are what JSON
        has: None, True and False, numbers, texts, lists, dictionaries with texts as keys (arrays by `tolist()`, a
        generator of random numbers by its `bit_generator.state`). A controller that depends on its observations alone
        gives {}.

        Returns:
            The values by name; None, as here, where the controller cannot say: a resumed run begins with `reset` then.
        """
        return None

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on from what `save` gave; called after `reset`.

        What it then asks for must be what it would have asked for, had the run not been interrupted.

        Raises:
            PluginError: the class has no `restore` of its own.
        """
        if saved:
            raise PluginError(f"{type(self).__qualname__} has save() without restore(); write both, or neither")

    def base_stops_at(self, observation: Observation) -> float | None:
        """The earliest time from which the base stays where it is in a run that begins with an observation [s].

        None where only the run itself shows it. A run whose goal is to be judged before is warned of.
        """
        return None

    def summary(self) -> dict[str, str]:
        """Rows for the table that closes a run, value by name."""
        return {}
