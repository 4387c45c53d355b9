"""A run in progress, for life-cycle hooks, key sources and displays."""

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from taichisoft.control.controller import Controller, Slider
from taichisoft.control.keys import KeyEvent, KeyStream
from taichisoft.errors import PluginError, TaichisoftError
from taichisoft.session.key_log import KeyReplay
from taichisoft.session.output import Output
from taichisoft.session.pace import Pace
from taichisoft.time_stepper import TimeStepper

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
        saved: what the controller remembers then, as `Controller.save` gave it; None: it begins with `reset` alone.
        make_controller: makes the controller anew with changed settings; None: it cannot be made anew.
        tuned: settings of the controller that were changed since, by name.
        notice: text for displays about the session itself, such as why a plug-in was not loaded anew.
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
        """Assemble a run.

        Args:
            simulation: the simulation, which continues from its present state.
            controller: the controller.
            outputs: the outputs.
            duration: simulated time [s]; None: the scene's; infinite: until the run is stopped.
            folder: folder for the key log.
            speed: simulated over wall-clock time [-]; None: as fast as possible.
            replay: keys of an earlier session.
            saved: what the controller goes on from, as its `save` gave it; None: it begins with `reset` alone.
            make_controller: makes the controller anew with changed settings, for sliders of its tunable settings and
                for files of plug-ins that were saved; None: it cannot be made anew.

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
        found = {key: replace(one, group=one.group or name) for key, one in controller.sliders.items()}
        given = scene.controller.settings if scene.controller is not None else {}
        for key, one in controller.tunable.items() if self.make_controller is not None else ():
            value = self.tuned.get(key, given.get(key, one.value))
            found[key] = replace(one, value=float(value), group=one.group or f"settings of {name}")
        return found

    def stop(self) -> None:
        """End the run before the next step, with complete outputs; may be called from any thread."""
        self.stops = True


def require_base(part: Part, base: type) -> Part:
    """Return a controller or output if it is derived from its base class.

    Raises:
        PluginError: the part is not derived from the base class.
    """
    if isinstance(part, base):
        return part
    if isinstance(part, type):
        raise PluginError(f"{part.__module__}.{part.__qualname__} is a class; give an object of it")
    kind = f"taichisoft.{base.__name__}"
    made_of = f"{type(part).__module__}.{type(part).__qualname__}"
    raise PluginError(f"{part!r} is not a {kind}; derive its class, {made_of}, from {kind}")


def count_steps(duration: float, time_step: float) -> float:
    """Number of whole steps in a duration [s], at least one; infinite for an infinite duration.

    Raises:
        TaichisoftError: the duration is not a positive number.
    """
    if not duration > 0.0:
        raise TaichisoftError(f"duration = {duration:g}: must be a positive number of seconds")
    return max(1, round(duration / time_step)) if math.isfinite(duration) else math.inf
