"""A run in progress: its session, outputs, pace, and the log of its keys."""

import json
import math
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from taichisoft.base.files import named_os_errors
from taichisoft.control.control import Control, Controller, Force, KeyEvent, KeyStream, Slider
from taichisoft.errors import PluginError, TaichisoftError, nearest
from taichisoft.step.time_stepper import TimeStepper

if TYPE_CHECKING:
    from taichisoft.contact.model import Model
    from taichisoft.mechanics.state import State
    from taichisoft.step.solution import StepReport

# Base class of outputs, which record a run.


class Output(ABC):
    """Base class of outputs; only `record` is abstract.

    An output is made as `factory(folder, **settings)`, with the output folder of the run and settings from options of
    `taichisoft run`. Its methods are then called in the order of their definition.

    Attributes:
        gives_keys: whether the output puts keys into the session, to steer a run without a terminal.
        save_controller: function that returns as JSON what the controller of the run remembers now, see
            `Controller.save`; empty for a controller that does not save. The run sets it before `begin`.
    """

    gives_keys: bool = False
    save_controller: Callable[[], str] = staticmethod(lambda: "")

    def begin(self, model: "Model", state: "State") -> None:
        """Begin a run; called once, with the state before the first step."""

    @abstractmethod
    def record(self, state: "State", report: "StepReport") -> None:
        """Record a step; called after every step. A state never changes, so it may be kept."""

    def restart(self, state: "State") -> None:
        """Note that the user restarts the run from this state, at its earlier time."""

    def end(self, outcome: str) -> None:
        """End the run; called once, however the run ended.

        An error raised here is shown after every output has ended; `taichisoft.errors.GoalMissed` means that the run
        missed the goal of its scene.

        Args:
            outcome: "completed", "stopped" by its user, "interrupted", or the text of the error.
        """

    def summary(self) -> dict[str, str]:
        """Rows of the closing table of a run, value by name; called last."""
        return {}


# The speed of a run: real time, or a chosen multiple.

AVERAGED = 1.0
"""Wall-clock time over which the speed of a run is averaged [s]."""
LONGEST_DELAY = 0.1
"""Largest delay that a run makes up for [s]; it does not hurry to make up for longer ones."""
KEEPING_UP = 0.95
"""Least share of the set speed at which a run still keeps up [-]."""


class Pace:
    """Limits the speed of a run, and measures it.

    Attributes:
        speed: set speed, simulated over wall-clock time [-]; None: as fast as possible.
        real_time_factor: speed in the last second, simulated over wall-clock time [-]; NaN before the first step.
    """

    def __init__(self, speed: float | None = None, clock: Callable[[], float] = time.perf_counter):
        """Start the measurement; `clock` returns seconds."""
        self.speed = speed
        self.real_time_factor = float("nan")
        self._clock = clock
        self._total_simulated = self._total_time = 0.0
        self.restart()

    def restart(self) -> None:
        """Restart the measurement, after a pause or a change of speed or time."""
        self._due = self._clock()
        self._recent: deque[tuple[float, float]] = deque([(self._due, 0.0)])

    @property
    def keeps_up(self) -> bool:
        """Whether the run reaches its set speed; True until a speed has been measured."""
        return self.speed is None or not self.real_time_factor < KEEPING_UP * self.speed

    @property
    def mean_real_time_factor(self) -> float:
        """Speed of the whole run without its pauses, simulated over wall-clock time; NaN before the first step."""
        return self._total_simulated / self._total_time if self._total_time else float("nan")

    def seconds_to_wait(self, time_step: float) -> float:
        """Time to wait after a step that simulated `time_step` [s]; negative when the run is late [s]."""
        now = self._clock()
        simulated = self._recent[-1][1] + time_step
        if self.speed is None:
            wait = 0.0
        else:
            self._due += time_step / self.speed
            wait = self._due - now
            if wait < -LONGEST_DELAY:
                self._due = now
        self._measure(now + max(wait, 0.0), simulated)
        return wait

    def _measure(self, now: float, simulated: float) -> None:
        self._total_simulated += simulated - self._recent[-1][1]
        self._total_time += now - self._recent[-1][0]
        self._recent.append((now, simulated))
        while len(self._recent) > 2 and now - self._recent[1][0] > AVERAGED:
            self._recent.popleft()
        (start, first), (end, last) = self._recent[0], self._recent[-1]
        if end > start:
            self.real_time_factor = (last - first) / (end - start)


# Log of the keys of a session: one JSON object per line, with the number of steps before the key was handled.

FILE_NAME = "keys.jsonl"


class KeyLogError(TaichisoftError):
    """A key log cannot be written or read."""


class KeyLog:
    """Writes each key at once, so that a killed session leaves a complete log."""

    def __init__(self, path: Path):
        """Create the file."""
        self._path = path
        with named_os_errors(path, KeyLogError):
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("w", encoding="utf-8", buffering=1)

    def add(self, step: int, event: KeyEvent) -> None:
        """Write a key handled after `step` steps of the session."""
        more: dict[str, Any] = {"ctrl": True} if event.ctrl else {}
        if event.value is not None:
            more["value"] = event.value
        if event.pointer is not None:
            more["pointer"] = event.pointer
        self._write({"step": step, "key": event.key, **more})

    def end(self, step: int) -> None:
        """Write the total number of steps of the session, and close the file."""
        self._write({"step": step, "end": True})
        self._file.close()

    def _write(self, line: dict[str, Any]) -> None:
        with named_os_errors(self._path, KeyLogError):
            self._file.write(json.dumps(line) + "\n")


class KeyReplay:
    """The keys of an earlier session, each to be replayed after the same number of steps.

    Attributes:
        step_count: number of steps of that session; if it was killed, number of steps up to its last key.
    """

    def __init__(self, path: Path):
        """Read the whole file."""
        self._events: list[tuple[int, KeyEvent]] = []
        self.step_count = 0
        try:
            lines = path.read_text(encoding="utf-8").splitlines()
        except (OSError, UnicodeDecodeError) as error:
            raise KeyLogError(f"{path}: not readable as a key log: {error}") from error
        for number, line in enumerate(lines, 1):
            step, event = _parse(line, f"{path}, line {number}")
            if step < self.step_count:
                raise KeyLogError(f"{path}, line {number}: step = {step}: must not be below {self.step_count}")
            self.step_count = step
            if event is not None:
                self._events.append((step, event))

    def take(self, step: int) -> list[KeyEvent]:
        """Remove and return the keys handled after `step` steps."""
        taken = []
        while self._events and self._events[0][0] <= step:
            taken.append(self._events.pop(0)[1])
        return taken


def _parse(line: str, where: str) -> tuple[int, KeyEvent | None]:
    try:
        content = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise KeyLogError(f"{where}: not readable as JSON: {error}") from error
    valid = 'must look like {"step": 12, "key": "+"} or {"step": 40, "end": true}'
    if not isinstance(content, dict) or type(content.get("step")) is not int or content["step"] < 0:
        raise KeyLogError(f"{where}: {line.strip()}: {valid}")
    if content.get("end") is True:
        return content["step"], None
    if not isinstance(content.get("key"), str) or not isinstance(content.get("ctrl", False), bool):
        raise KeyLogError(f"{where}: {line.strip()}: {valid}")
    value = content.get("value")
    if value is not None and (type(value) not in (int, float) or not math.isfinite(value)):
        raise KeyLogError(f"{where}: value = {value!r}: must be a finite number")
    pointer = content.get("pointer")
    if pointer is not None and not (
        isinstance(pointer, list)
        and len(pointer) in (0, 3)
        and all(type(one) in (int, float) and math.isfinite(one) for one in pointer)
    ):
        raise KeyLogError(f"{where}: pointer = {pointer!r}: must be 3 finite numbers, or []")
    pulled = None if pointer is None else tuple(map(float, pointer))
    return content["step"], KeyEvent(content["key"], content.get("ctrl", False), value, pulled)


# A body that a person pulls by a spring, from a point of it to a pointer.

SWING = 20.0
"""Angular frequency of the body's mass on the spring [rad/s]: strong enough to lift it by a few centimetres."""
LARGEST_TURN = 0.2
"""Most of a swing in a time step, beyond which the spring is weaker [rad]: it acts explicitly."""


class Pull:
    """A spring between a point of a body and a pointer; it damps rigid bodies, since soft ones have their own damping.

    Attributes:
        body: its name.
        pointer: where the spring ends [mm], shape (3,).
    """

    def __init__(self, model: "Model", state: "State", body: str, picked: Sequence[float]):
        """Hold what is at a place of a body in a state [mm].

        Raises:
            TaichisoftError: no body is called so, or a frame carries it.
        """
        places = model.external_forces
        if body not in places.movable:
            known = nearest(body, list(places.movable), "there are")
            raise TaichisoftError(f"no body that can be pulled is called '{body}'; {known}")
        self.body, self.pointer = body, np.array(picked)
        self._places, self._number = places, places.names.index(body)
        self._point = places.rest_of(state, self._number, self.pointer)
        swing = min(SWING, LARGEST_TURN / model.scene.time.step)
        soft = {one.name: float(one.node_mass.sum()) for one in model.soft_bodies}
        rigid = {one.name: one.mass for one in model.rigid_bodies}
        self._stiffness = (soft | rigid)[body] * swing**2
        self._damping = rigid.get(body, 0.0) * swing

    def added_to(self, control: Control, state: "State") -> Control:
        """A controller's request with the force of the spring in place of its own on the body."""
        place, velocity = self._places.motion(state, self._number, self._point)
        force = self._stiffness * (self.pointer - place) - self._damping * velocity
        return replace(control, forces={**control.forces, self.body: Force(force, point=self._point, steps=1)})


# A run in progress, for life-cycle hooks, key sources and displays.

RECENT_KEYS = 8

Part = TypeVar("Part")

# Effects of the keys of the run itself; all others go to the controller.
BINDINGS = {
    "space": "pause, and go on",
    "s": "make a single step",
    "r": "restart from the first state",
    "p": "take a picture",
    "?": "show the keys",
    "escape": "end the run (as Ctrl and c)",
}


class Session:
    """A run in progress: its parts and its current status.

    Attributes:
        simulation: the simulation, with its model, state and last report.
        controller: the controller.
        outputs: the outputs, in the order in which they record a step.
        folder: folder for the results; None: nothing is written.
        duration: simulated time after which the run ends [s]; infinite: until it is stopped.
        step_count: number of steps after which the run ends; infinite: until it is stopped.
        keys: stream of key events, for any thread to put them into.
        pace: set speed, and speed of the last second.
        paused: whether the run waits for a key.
        single_steps: number of steps still to be made while paused.
        shows_help: whether the help of the keys is shown.
        steps_made: number of steps since the run began; a restart does not reset it.
        recent_keys: last key events handled.
        replay: keys of an earlier session, which replace the events in `keys`, or None.
        first_state: state at the start and after a restart.
        saved: the controller's memory then, as `Controller.save` gave it; None: `reset` alone.
        make_controller: makes the controller anew with changed settings; None: it cannot be made anew.
        tuned: settings of the controller that were changed since, by name.
        pull: what a person pulls, or None.
        notice: text for displays about the session itself, such as why a setting was not tuned.
        stops: whether the run ends before the next step.
    """

    def __init__(
        self,
        simulation: TimeStepper,
        controller: Controller,
        outputs: Sequence[Output] = (),
        duration: float | None = None,
        folder: Path | None = None,
        speed: float | None = None,
        replay: KeyReplay | None = None,
        saved: Mapping[str, Any] | None = None,
        make_controller: Callable[[Mapping[str, Any]], Controller] | None = None,
    ):
        """Assemble a run, which continues from the present state of the simulation; see the attributes.

        Args:
            simulation, controller, outputs, folder, replay, saved, make_controller: the attributes of these names.
            duration: simulated time [s]; None: the scene's; infinite: until the run is stopped.
            speed: simulated over wall-clock time [-]; None: as fast as possible.

        Raises:
            PluginError: the controller is not a `Controller`, or an output is not an `Output`.
            TaichisoftError: the duration is not a positive number.
        """
        self.simulation = simulation
        self.controller = require_base(controller, Controller)
        self.outputs = [require_base(output, Output) for output in outputs]
        self.duration = duration if duration is not None else simulation.model.scene.time.duration
        self.step_count = count_steps(self.duration, simulation.model.scene.time.step)
        self.folder = folder
        self.pace = Pace(speed)
        self.keys = KeyStream()
        self.paused = False
        self.single_steps = 0
        self.shows_help = False
        self.steps_made = 0
        self.recent_keys: deque[KeyEvent] = deque(maxlen=RECENT_KEYS)
        self.replay = replay
        self.first_state = simulation.state
        self.saved = saved
        self.make_controller = make_controller
        self.tuned: dict[str, float] = {}
        self.pull: Pull | None = None
        self.notice = ""
        self.stops = False

    @property
    def replaying(self) -> bool:
        """Whether the keys come from an earlier session."""
        return self.replay is not None

    @property
    def bindings(self) -> dict[str, str]:
        """Effect of each key by key: the controller's own, then the run's."""
        return {**self.controller.bindings, **BINDINGS}

    @property
    def finished(self) -> bool:
        """Whether all steps are made: for the duration since the last start, or of the replayed session."""
        if self.replay is not None:
            return self.steps_made >= self.replay.step_count
        return self.simulation.state.step - self.first_state.step >= self.step_count

    @property
    def sliders(self) -> dict[str, Slider]:
        """All sliders of the session with their present values: the controller's own, and its tunable settings."""
        controller, scene = self.controller, self.simulation.model.scene
        name = scene.controller.name if scene.controller is not None else "controller"
        sliders = {key: replace(slider, group=slider.group or name) for key, slider in controller.sliders.items()}
        given = scene.controller.settings if scene.controller is not None else {}
        for key, slider in controller.tunable.items() if self.make_controller is not None else ():
            value = self.tuned.get(key, given.get(key, slider.value))
            sliders[key] = replace(slider, value=float(value), group=slider.group or f"settings of {name}")
        return sliders

    def stop(self) -> None:
        """End the run before the next step, with complete outputs; may be called from any thread."""
        self.stops = True


def require_base(part: Part, base: type) -> Part:
    """Return a controller or output if it is derived from its base class."""
    if isinstance(part, base):
        return part
    if isinstance(part, type):
        raise PluginError(f"{part.__module__}.{part.__qualname__} is a class; give an object of it")
    kind = f"taichisoft.{base.__name__}"
    made_of = f"{type(part).__module__}.{type(part).__qualname__}"
    raise PluginError(f"{part!r} is not a {kind}; derive its class, {made_of}, from {kind}")


def count_steps(duration: float, time_step: float) -> float:
    """Number of whole steps in a duration [s], at least one; infinite for an infinite duration."""
    if not duration > 0.0:
        raise TaichisoftError(f"duration = {duration:g}: must be a positive number of seconds")
    return max(1, round(duration / time_step)) if math.isfinite(duration) else math.inf
