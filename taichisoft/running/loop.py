"""The loop around the step: keys, controller, step, outputs. The only place that calls plug-ins during a run."""

import json
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

import numpy as np

from taichisoft.base.processes import deferred_signals, stop_if_asked
from taichisoft.base.text import warn_caller
from taichisoft.control.control import Control, Controller, KeyEvent
from taichisoft.errors import ControlError, GoalMissed, PluginError, TaichisoftError
from taichisoft.running.hooks import notify
from taichisoft.running.plugins import failures_of
from taichisoft.running.session import BINDINGS, FILE_NAME, KeyLog, Output, Pull, Session
from taichisoft.running.simulation import Simulation
from taichisoft.running.training_watch import TrainingWatch
from taichisoft.scene.scene import Scene
from taichisoft.step.solution import StepReport

# Handling of the keys of a run: keys of the run itself, and keys for the controller.

# Keys that change when steps are made, but not which steps; a replay ignores them.
WAITING_KEYS = ("space", "s")


class KeyHandling:
    """Handles the keys of a session between two steps, and writes its key log."""

    def __init__(self, session: Session, pass_to_controller: Callable[[KeyEvent], None], restart: Callable[[], None]):
        """Prepare; the key log of an interactive run is made at once, other logs with the first key."""
        self._session = session
        self._pass_to_controller = pass_to_controller
        self._actions: dict[str, Callable[[], None]] = {
            "space": self._toggle_pause,
            "s": self._make_single_step,
            "r": restart,
            "p": lambda: notify("taichisoft_picture_wanted", session=session),
            "?": self._show_help,
            "escape": session.stop,
        }
        assert self._actions.keys() == BINDINGS.keys()
        self._log: KeyLog | None = None
        if session.controller.interactive:
            self._open_log()

    def handle_keys(self) -> None:
        """Handle the keys since the last call."""
        for event in self._new_events():
            if event.pointer is not None:
                self._pull(event.key, event.pointer)
                continue
            self._session.recent_keys.append(event)
            action = self._actions.get(event.key) if event.value is None else None
            if action is not None:
                action()
            else:
                self._pass_to_controller(event)

    def end(self) -> None:
        """Close the log with the number of steps made."""
        if self._log is not None:
            self._log.end(self._session.steps_made)

    def _new_events(self) -> Iterator[KeyEvent]:
        """Keys in their order; keys of a replayed log are written again, keys pressed during a replay are not."""
        session = self._session
        pressed = session.keys.take()
        if session.replay is None:
            for event in pressed:
                self._write(event)
                yield event
            return
        for event in session.replay.take(session.steps_made):
            self._write(event)
            if not (_is_key(event) and event.key in WAITING_KEYS):
                yield event
        yield from (event for event in pressed if _is_key(event) and event.key in BINDINGS and event.key != "r")

    def _write(self, event: KeyEvent) -> None:
        if self._log is None:
            self._open_log()
        if self._log is not None:
            self._log.add(self._session.steps_made, event)

    def _open_log(self) -> None:
        if self._session.folder is not None:
            self._log = KeyLog(self._session.folder / FILE_NAME)

    def _pull(self, body: str, pointer: Sequence[float]) -> None:
        """Pick, pull or let go a body."""
        session = self._session
        if not pointer:
            session.pull = None
        elif session.pull is None or session.pull.body != body:
            session.pull = Pull(session.simulation.model, session.simulation.state, body, pointer)
        else:
            session.pull.pointer = np.array(pointer)

    def _toggle_pause(self) -> None:
        self._session.paused = not self._session.paused

    def _make_single_step(self) -> None:
        self._session.paused = True
        self._session.single_steps += 1

    def _show_help(self) -> None:
        self._session.shows_help = not self._session.shows_help


def _is_key(event: KeyEvent) -> bool:
    return event.value is None and event.pointer is None


# A controller's memory as JSON: outputs keep it, and a run that resumes gives it back.

PLAIN = (str, int, float, type(None))  # True and False are integers


def saved_as_json(controller: Controller) -> str:
    """What a controller remembers now, as JSON that gives the same bits back; empty where it does not save."""
    name = f"controller {type(controller).__module__}.{type(controller).__qualname__}"
    with failures_of(f"{name} failed in save()"):
        saved = controller.save()
    if saved is None:
        return ""
    if not isinstance(saved, dict):
        raise PluginError(f"{name}: save() returned {_shown(saved)}; must be a dict, or None")
    _check(saved, "", name)
    return json.dumps(saved)


def _check(value: Any, key: str, name: str) -> None:
    """Refuse what JSON cannot hold, or gives back as something else."""
    if isinstance(value, dict):
        for inner, content in value.items():
            if not isinstance(inner, str):
                raise PluginError(f"{name}: save(): {key or 'a key'}: key {_shown(inner)} must be a text")
            _check(content, f"{key}.{inner}".strip("."), name)
    elif isinstance(value, list | tuple):
        for number, content in enumerate(value):
            _check(content, f"{key}.{number}", name)
    elif not isinstance(value, PLAIN):
        raise PluginError(f"{name}: save(): {key} = {_shown(value)}: {_advice(value)}")


def _advice(value: Any) -> str:
    """What to save instead of a value that JSON cannot hold."""
    if hasattr(value, "bit_generator"):
        return "save its `bit_generator.state`"
    return "save its `tolist()`" if hasattr(value, "tolist") else "must be a number, a text, a list, or a dict of these"


def _shown(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."


# Settings of a controller that are tuned during the run.

TUNED = "tuned settings"
"""What a controller remembers has the settings that were tuned under this name."""


def memory_as_json(session: Session) -> str:
    """What the session's controller remembers, with the settings that were tuned; empty where it does not save."""
    memory = saved_as_json(session.controller)
    return json.dumps({**json.loads(memory), TUNED: session.tuned}) if memory and session.tuned else memory


def _begin_controller(session: Session) -> None:
    """Reset the controller, and restore what the session has saved of it, with the settings that were tuned."""
    saved = dict(session.saved) if session.saved is not None else None
    if saved is not None and TUNED in saved:
        session.tuned = {**saved.pop(TUNED), **session.tuned}
        if session.make_controller is not None:
            session.controller = _made_controller(session)
    _reset_controller(session, session.controller, saved)


def _tune(session: Session, name: str, value: float) -> bool:
    """Replace the controller by one with another value of a tunable setting; False if there is no such setting.

    If the new one cannot be made, the old one stays.
    """
    controller = session.controller
    if name not in controller.tunable or session.make_controller is None:
        return False
    slider, before, memory = controller.tunable[name], dict(session.tuned), saved_as_json(controller)
    session.tuned[name] = min(max(value, slider.lowest), slider.highest)
    try:
        with failures_of(f"controller {_name(controller)} cannot be made anew"):
            made = _made_controller(session)
        _reset_controller(session, made, json.loads(memory) if memory else None)
        session.controller = made
    except TaichisoftError as error:
        session.tuned = before
        # Without the time Python would not show the same text a second time.
        text = f"at {session.simulation.state.time:.6g} s: the old controller goes on: {error}"
        session.notice = " ".join(text.split())
        warn_caller(session.notice)
    return True


def _made_controller(session: Session) -> Controller:
    """A new controller with the settings that were tuned."""
    assert session.make_controller is not None
    made = session.make_controller(session.tuned)
    if made.interactive != session.controller.interactive:
        made.interactive = session.controller.interactive
    return made


def _reset_controller(session: Session, controller: Controller, saved: Mapping[str, Any] | None) -> None:
    _call(controller, controller.reset, session.simulation.model)
    if saved is not None:
        _call(controller, controller.restore, saved)


# Time limit for calls of plug-in code.

Answer = TypeVar("Answer")


class TimeLimitExceeded(Exception):
    """A call exceeded its time limit.

    Attributes:
        seconds: time until the call returned or was interrupted [s].
    """

    def __init__(self, seconds: float):
        super().__init__(f"took {seconds:.3g} s")
        self.seconds = seconds


class _Alarm(KeyboardInterrupt):
    """An interruption, not an Exception, so that the interrupted code does not catch it as its own."""


def call_within(limit: float | None, function: Callable[..., Answer], *arguments: Any) -> Answer:
    """Call a function with a time limit [s], and return its result.

    In the main thread of a system with interval timers, a call that never returns is interrupted; otherwise the time is
    checked after the call.
    """
    if limit is None:
        return function(*arguments)
    started = time.perf_counter()
    if hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread():
        result = _call_with_alarm(limit, function, *arguments)
    else:
        result = function(*arguments)
    seconds = time.perf_counter() - started
    if seconds > limit:
        raise TimeLimitExceeded(seconds)
    return result


def _call_with_alarm(limit: float, function: Callable[..., Answer], *arguments: Any) -> Answer:
    started = time.perf_counter()
    before = signal.signal(signal.SIGALRM, _raise)
    try:
        try:
            signal.setitimer(signal.ITIMER_REAL, limit)
            return function(*arguments)
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
    except _Alarm:  # may arrive while the timer is being cancelled
        raise TimeLimitExceeded(time.perf_counter() - started) from None
    finally:
        signal.signal(signal.SIGALRM, before)


def _raise(_number: int, _frame: Any) -> None:
    raise _Alarm


# The loop around the step: keys, controller, step, outputs. The only place that calls plug-ins during a run.

COMPLETED = "completed"
STOPPED = "stopped"
INTERRUPTED = "interrupted"


# Longest time between two checks for signals and, in a paused run, for keys [s].
LONGEST_WAIT = 0.05


def run(
    simulation: Simulation,
    controller: Controller,
    outputs: Sequence[Output] = (),
    duration: float | None = None,
    on_step: Callable[[StepReport], None] | None = None,
    saved: Mapping[str, Any] | None = None,
) -> str:
    """Drive a simulation from its present state and show every step to the outputs.

    Args:
        simulation: the simulation; stays usable after the run, at its last valid state.
        controller: called before every step, or every `controller.period` of the scene.
        outputs: record every step, and are always ended, whatever happens.
        duration: simulated time [s]; None: the scene's; infinite: until a key or `Session.stop` ends the run.
        on_step: called after every step, for a progress display.
        saved: memory that the controller resumes with, as its `save` gave it at this state; None: `reset` alone.

    Returns:
        "completed"; "stopped" by a key or by `Session.stop`; "interrupted" by Ctrl and c,
        SIGTERM or a hang-up.

    Raises:
        PluginError: the controller is not a `Controller`, an output is not an `Output`, or a plug-in failed.
        ControlError: the controller requested something impossible.
        SimulationDiverged: a step failed.
        GoalMissed: the controller failed, or the run missed the goal of its scene according to an output.
        BeyondLaw: the run completed, but stretched a body far beyond the range of its law.
        TaichisoftError: the duration is not positive, or an output failed to write; the outputs keep the results
            computed before any of these errors.
    """
    return run_session(Session(simulation, controller, outputs, duration, saved=saved), on_step)


def run_session(session: Session, on_step: Callable[[StepReport], None] | None = None) -> str:
    """Run a session as `run` does, until its duration is over or it is stopped.

    Raises:
        TaichisoftError: as for `run`.
    """
    begun: list[Output] = []
    errors: list[BaseException] = []
    hooks_called = False
    with deferred_signals():
        try:
            _begin_controller(session)
            for output in session.outputs:
                begun.append(output)
                output.save_controller = partial(memory_as_json, session)
                _call(output, output.begin, session.simulation.model, session.simulation.state)
            hooks_called = True
            notify("taichisoft_run_begins", session=session)
            outcome = _advance(session, on_step)
        except KeyboardInterrupt:
            outcome = INTERRUPTED
        except BaseException as error:
            outcome = str(error) or type(error).__name__
            errors.append(error)
        errors += _end_all(begun, outcome)
        if hooks_called:
            errors += _problems(notify, "taichisoft_run_ends", session=session, outcome=outcome)
    for later in errors[1:]:
        warn_caller(str(later))
    if errors:
        raise errors[0]
    return outcome


def _advance(session: Session, on_step: Callable[[StepReport], None] | None) -> str:
    """Make the steps; returns the outcome."""
    training_watch = TrainingWatch(session.simulation.model)
    session.simulation.strain_watch.restart(is_new_run=True)
    for complaint in training_watch.complaints_at_start():
        warn_caller(complaint)
    key_handling = KeyHandling(session, partial(_take_key, session), partial(_restart, session))
    warnings, scene = list(WARNINGS), session.simulation.model.scene
    session.pace.restart()
    try:
        while True:
            stop_if_asked()
            key_handling.handle_keys()
            if session.stops or session.finished:
                session.simulation.strain_watch.judge(session.simulation.state, session.simulation.report)
                return STOPPED if session.stops else COMPLETED
            if session.paused and not session.single_steps:
                session.keys.wait(LONGEST_WAIT)
                session.pace.restart()
                continue
            report = _step(session)
            for warning in list(warnings):
                is_due, text = warning
                if is_due(scene, report):
                    warnings.remove(warning)
                    warn_caller(f"step {report.step}: {text(scene, report)}")
            for complaint in training_watch.complaints(session.simulation.state, report):
                warn_caller(complaint)
            if on_step is not None:
                on_step(report)
            _wait_for_pace(session)
    finally:
        key_handling.end()


def _step(session: Session) -> StepReport:
    """Controller, step, outputs, hooks."""
    simulation = session.simulation
    control = _next_control(session)
    if session.pull is not None and isinstance(control, Control) and isinstance(control.forces, Mapping):
        control = session.pull.added_to(control, simulation.state)
    try:
        report = simulation.step(control)
    except ControlError as error:
        raise ControlError(
            f"controller {_name(session.controller)} at step {simulation.state.step}: {error}"
        ) from error
    session.steps_made += 1
    session.single_steps = max(0, session.single_steps - 1)
    for output in session.outputs:
        _call(output, output.record, simulation.state, report)
    notify("taichisoft_step_done", session=session, report=report)
    return report


def _next_control(session: Session) -> Control:
    """The controller's request; an empty one within its period."""
    simulation, controller, scene = session.simulation, session.controller, session.simulation.model.scene
    if simulation.state.step % scene.steps_per_control:
        return Control()
    limit = scene.controller.time_limit if scene.controller is not None else None
    try:
        request: Control = call_within(limit, _call, controller, controller.control, simulation.observe())
    except TimeLimitExceeded as error:
        raise PluginError(
            f"controller {_name(controller)} took {error.seconds:.3g} s in control() at step "
            f"{simulation.state.step}; controller.time_limit is {limit:g} s"
        ) from error
    if request is None:
        raise ControlError(
            f"controller {_name(controller)} at step {simulation.state.step}: control() returned None; must return a "
            "taichisoft.Control; Control() requests nothing new: is a return missing?"
        )
    return request


def _take_key(session: Session, event: KeyEvent) -> None:
    """Hand a key or a moved slider to the controller, or tune it."""
    if event.value is None or not _tune(session, event.key, event.value):
        _call(session.controller, session.controller.key, event)


def _restart(session: Session) -> None:
    session.simulation.strain_watch.restart()
    session.simulation.restore(session.first_state)
    session.pull = None
    _begin_controller(session)
    for output in session.outputs:
        _call(output, output.restart, session.first_state)
    session.pace.restart()


def _wait_for_pace(session: Session) -> None:
    wait = session.pace.seconds_to_wait(session.simulation.model.scene.time.step)
    while wait > 0.0:
        time.sleep(min(wait, LONGEST_WAIT))
        wait -= LONGEST_WAIT
        stop_if_asked()


def _newton_failed(scene: Scene, report: StepReport) -> bool:
    return report.newton_residual is not None and not report.newton_residual <= scene.time.newton_tolerance


def _quoted_pair(report: StepReport) -> str:
    return " and ".join(f"'{name}'" for name in report.deepest or ())


def _cause_of_overlap(scene: Scene, report: StepReport) -> str:
    if report.step == 0:
        return "they overlap at the start; move one of them away"
    if not report.converged:
        return "the contact solver has not converged; take a smaller time.step"
    return (
        f"a body moved too far in a step of {scene.time.step:g} s; take a smaller time.step, or a larger "
        "contact.contact_distance"
    )


# What is warned of once in a run, by the scene and the report of a step: when, and with which text.
Warned = tuple[Callable[[Scene, StepReport], bool], Callable[[Scene, StepReport], str]]
WARNINGS: tuple[Warned, ...] = (
    (
        lambda scene, report: not report.converged and not _newton_failed(scene, report),
        lambda scene, report: (
            f"the contact solver stopped after {report.iterations} sweeps with a residual of {report.residual:.2g} "
            f"mm/s, above contact.tolerance = {scene.contact.tolerance:g}; later steps are counted, not reported"
        ),
    ),
    (
        _newton_failed,
        lambda scene, report: (
            f"after {report.linearisations} linearisations another would move a node by {report.newton_residual:.2g} "
            f"mm, more than time.newton_tolerance = {scene.time.newton_tolerance:g}; later steps are counted, not "
            "reported"
        ),
    ),
    (
        lambda scene, report: report.inverted_elements > 0,
        lambda scene, report: (
            f"{report.inverted_elements} elements are inverted; a smaller time.step, or time.newton = 20, or a finer "
            "mesh may prevent it; metrics.json has the largest number and the last"
        ),
    ),
    (
        lambda scene, report: report.max_penetration > scene.contact.contact_distance,
        lambda scene, report: (
            f"{_quoted_pair(report)} overlap by "
            f"{report.max_penetration - scene.contact.contact_distance:.2g} mm: {_cause_of_overlap(scene, report)}; "
            "later overlaps are counted, not reported"
        ),
    ),
)


def _call(part: Controller | Output, method: Callable[..., Answer], *arguments: Any) -> Answer:
    """Call a method of a controller or output; unexpected exceptions become errors with its name."""
    kind = "controller" if isinstance(part, Controller) else "output"
    with failures_of(f"{kind} {_name(part)} failed in {method.__name__}()"):
        return method(*arguments)


def _name(part: Controller | Output) -> str:
    return f"{type(part).__module__}.{type(part).__qualname__}"


def _end_all(outputs: Sequence[Output], outcome: str) -> list[BaseException]:
    """End every output, even if one fails or is interrupted; failures of outputs come before missed goals."""
    problems = [problem for output in outputs for problem in _problems(_call, output, output.end, outcome)]
    return sorted(problems, key=lambda problem: isinstance(problem, GoalMissed))


def _problems(function: Callable[..., Any], *arguments: Any, **named: Any) -> list[BaseException]:
    """Call a function, and return its exceptions instead of raising them."""
    try:
        function(*arguments, **named)
    except BaseException as error:
        return [error]
    return []
