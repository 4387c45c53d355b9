"""The loop around the step: keys, controller, step, outputs. The only place that calls plug-ins during a run."""

import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

from taichisoft.building.simulation import Simulation
from taichisoft.caller_warnings import warn_caller
from taichisoft.control.control import Control
from taichisoft.control.controller import Controller
from taichisoft.control.keys import KeyEvent
from taichisoft.errors import ControlError, GoalMissed, PluginError
from taichisoft.interruption import deferred_signals, stop_if_asked
from taichisoft.plugin_system.failure import failures_of
from taichisoft.plugin_system.hooks import notify
from taichisoft.running.controller_changes import ControllerChanges, memory_as_json
from taichisoft.running.key_handling import KeyHandling
from taichisoft.running.time_limit import TimeLimitExceeded, call_within
from taichisoft.running.training_watch import TrainingWatch
from taichisoft.session.output import Output
from taichisoft.session.session import Session
from taichisoft.step.report import StepReport

COMPLETED = "completed"
STOPPED = "stopped"
INTERRUPTED = "interrupted"

Answer = TypeVar("Answer")

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
        saved: what the controller goes on from, as its `save` gave it at this state; None: it begins with `reset`.

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
            changes = ControllerChanges(session)
            changes.begin()
            for output in session.outputs:
                begun.append(output)
                output.save_controller = partial(memory_as_json, session)
                _call(output, output.begin, session.simulation.model, session.simulation.state)
            hooks_called = True
            notify("taichisoft_run_begins", session=session)
            outcome = _advance(session, changes, on_step)
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


def _advance(session: Session, changes: ControllerChanges, on_step: Callable[[StepReport], None] | None) -> str:
    """Make the steps; returns the outcome."""
    training_watch = TrainingWatch(session.simulation.model)
    session.simulation.strain_watch.restart(is_new_run=True)
    for complaint in training_watch.complaints_at_start():
        warn_caller(complaint)
    key_handling = KeyHandling(session, partial(_take_key, session, changes), partial(_restart, session, changes))
    warned: set[Callable[..., None]] = set()
    session.pace.restart()
    try:
        while True:
            stop_if_asked()
            changes.look()
            key_handling.handle_keys()
            if session.stops or session.finished:
                session.simulation.strain_watch.judge(session.simulation.state, session.simulation.report)
                return STOPPED if session.stops else COMPLETED
            if session.paused and not session.single_steps:
                session.keys.wait(LONGEST_WAIT)
                session.pace.restart()
                continue
            report = _step(session)
            _warn_once(session, report, warned)
            state = session.simulation.state
            for complaint in training_watch.complaints(state, report):
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
        asked: Control = call_within(limit, _call, controller, controller.control, simulation.observe())
    except TimeLimitExceeded as error:
        raise PluginError(
            f"controller {_name(controller)} took {error.seconds:.3g} s in control() at step "
            f"{simulation.state.step}; controller.time_limit is {limit:g} s"
        ) from error
    if asked is None:
        raise ControlError(
            f"controller {_name(controller)} at step {simulation.state.step}: control() returned None; must return a "
            "taichisoft.Control; Control() requests nothing new: is a return missing?"
        )
    return asked


def _take_key(session: Session, changes: ControllerChanges, event: KeyEvent) -> None:
    """Hand a key or a moved slider to the controller, or tune it."""
    if event.value is None or not changes.tune(event.key, event.value):
        _call(session.controller, session.controller.key, event)


def _restart(session: Session, changes: ControllerChanges) -> None:
    session.simulation.strain_watch.restart()
    session.simulation.restore(session.first_state)
    changes.begin_again()
    for output in session.outputs:
        _call(output, output.restart, session.first_state)
    session.pace.restart()


def _wait_for_pace(session: Session) -> None:
    wait = session.pace.seconds_to_wait(session.simulation.model.scene.time.step)
    while wait > 0.0:
        time.sleep(min(wait, LONGEST_WAIT))
        wait -= LONGEST_WAIT
        stop_if_asked()


def _warn_once(session: Session, report: StepReport, warned: set[Callable[..., None]]) -> None:
    """Warn of each problem of a step, unless it has occurred in an earlier step."""
    time = session.simulation.model.scene.time
    newton_failed = report.newton_residual is not None and not report.newton_residual <= time.newton_tolerance
    wrong = {
        _warn_not_converged: not report.converged and not newton_failed,
        _warn_newton_not_converged: newton_failed,
        _warn_of_inverted_elements: report.inverted_elements > 0,
        _warn_of_overlap: report.max_penetration > session.simulation.model.scene.contact.contact_distance,
    }
    for warn, is_due in wrong.items():
        if is_due and warn not in warned:
            warned.add(warn)
            warn(session, report)


def _warn_not_converged(session: Session, report: StepReport) -> None:
    warn_caller(
        f"step {report.step}: the contact solver stopped after {report.iterations} sweeps with a residual of "
        f"{report.residual:.2g} mm/s, above contact.tolerance = {session.simulation.model.scene.contact.tolerance:g}; "
        "later steps are counted, not reported"
    )


def _warn_newton_not_converged(session: Session, report: StepReport) -> None:
    warn_caller(
        f"step {report.step}: after {report.linearisations} linearisations another would move a node by "
        f"{report.newton_residual:.2g} mm, more than time.newton_tolerance = "
        f"{session.simulation.model.scene.time.newton_tolerance:g}; later steps are counted, not reported"
    )


def _warn_of_inverted_elements(session: Session, report: StepReport) -> None:
    warn_caller(
        f"step {report.step}: {report.inverted_elements} elements are inverted; a smaller time.step, or "
        "time.newton = 20, or a finer mesh may prevent it; metrics.json has the largest number and the last"
    )


def _warn_of_overlap(session: Session, report: StepReport) -> None:
    scene = session.simulation.model.scene
    assert report.deepest is not None
    first, second = report.deepest
    if report.step == 0:
        cause = "they overlap at the start; move one of them away"
    elif not report.converged:
        cause = "the contact solver has not converged; take a smaller time.step"
    else:
        cause = (
            f"a body moved too far in a step of {scene.time.step:g} s; take a smaller "
            "time.step, or a larger contact.contact_distance"
        )
    depth = report.max_penetration - scene.contact.contact_distance
    warn_caller(
        f"step {report.step}: '{first}' and '{second}' overlap by {depth:.2g} mm: {cause}; later overlaps are counted, "
        "not reported"
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
