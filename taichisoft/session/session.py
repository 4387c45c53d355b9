"""A run in progress, as those who watch or steer it see it: life-cycle hooks, key sources, displays."""

import math
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

from taichisoft.control.controller import Controller
from taichisoft.control.keys import KeyEvent, KeyStream
from taichisoft.errors import PluginError, TaichisoftError
from taichisoft.session.key_log import KeyReplay
from taichisoft.session.output import Output
from taichisoft.session.pace import Pace
from taichisoft.simulation import Simulation

RECENT_KEYS = 8

Part = TypeVar("Part")

# Effects of the keys that the run itself heeds; all others go to the controller.
BINDINGS = {
    "space": "pause, and go on",
    "s": "make a single step",
    "r": "start anew from the first state",
    "p": "take a picture",
    "?": "show the keys",
    "escape": "end the run (as Ctrl and c)",
}


class Session:
    """A run in progress: what it is made of, and how it goes at the moment.

    Attributes:
        simulation: the simulation, with its model, state and last report.
        controller: the controller.
        outputs: the outputs, in the order in which they see a step.
        folder: folder for the results; None when nothing is written.
        duration: simulated time after which it ends [s]; infinite when somebody ends it.
        step_count: number of steps after which it ends; infinite when somebody ends it.
        keys: stream into which any thread puts key events.
        pace: speed that is wanted, and speed of the last second.
        paused: whether it waits for a key.
        single_steps: number of steps that are still to be made although it is paused.
        shows_help: whether somebody wants to see what the keys do.
        steps_made: number of steps since it began; starting anew does not set it back.
        recent_keys: last key events that were taken.
        replay: keys of an earlier session, which are taken instead of those in `keys`; None where there is none.
        first_state: state in which it began, and begins anew.
        stops: whether it ends before the next step.
    """

    def __init__(
        self,
        simulation: Simulation,
        controller: Controller,
        outputs: Sequence[Output] = (),
        duration: float | None = None,
        folder: Path | None = None,
        speed: float | None = None,
        replay: KeyReplay | None = None,
    ):
        """Put a run together.

        Args:
            simulation: goes on from its present state.
            controller: what drives the run.
            outputs: what watches it.
            duration: simulated time [s]; the scene's when it is not given, infinite for a run that somebody else ends.
            folder: folder for the key log.
            speed: simulated over wall-clock time; None for as fast as it goes.
            replay: keys of an earlier session.

        Raises:
            PluginError: the controller is no `Controller`, or an output no `Output`.
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
        """Whether all steps are made: those of its duration since the last start, or of the session that it replays."""
        if self.replay is not None:
            return self.steps_made >= self.replay.step_count
        return self.simulation.state.step - self.first_state.step >= self.step_count

    def stop(self) -> None:
        """End the run before the next step, its outputs complete; from any thread."""
        self.stops = True


def require_base(part: Part, base: type) -> Part:
    """Return a controller or output itself when it is derived from its base class.

    Raises:
        PluginError: it is not.
    """
    if isinstance(part, base):
        return part
    if isinstance(part, type):
        raise PluginError(f"{part.__module__}.{part.__qualname__} is a class; give an object of it")
    kind = f"taichisoft.{base.__name__}"
    made_of = f"{type(part).__module__}.{type(part).__qualname__}"
    raise PluginError(f"{part!r} is no {kind}; derive its class, {made_of}, from {kind}")


def count_steps(duration: float, time_step: float) -> float:
    """Whole steps in a duration, at least one; both in [s]. Infinite for an infinite duration.

    Raises:
        TaichisoftError: the duration is not a positive number.
    """
    if not duration > 0.0:
        raise TaichisoftError(f"duration = {duration:g}: must be a positive number of seconds")
    return max(1, round(duration / time_step)) if math.isfinite(duration) else math.inf
