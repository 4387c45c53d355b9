"""The loop around the step: controller, step, outputs. The only place that calls plug-ins while a run goes on."""

import math
import warnings
from collections.abc import Callable, Sequence
from typing import Any

from taichisoft.controller import Controller
from taichisoft.errors import GoalMissed, TaichisoftError
from taichisoft.interruption import held_back
from taichisoft.output import Output
from taichisoft.plugins import plugin_failure
from taichisoft.simulation import Simulation, StepReport

COMPLETED = "completed"
INTERRUPTED = "interrupted"


def run(
    simulation: Simulation,
    controller: Controller,
    outputs: Sequence[Output] = (),
    duration: float | None = None,
    on_step: Callable[[StepReport], None] | None = None,
) -> str:
    """Drive a simulation from its present state and show every step to the outputs.

    Args:
        simulation: stays usable after the run, at its last good state.
        controller: asked before every step.
        outputs: always ended, whatever happens.
        duration: [s]; the scene's when it is not given.
        on_step: called after every step, for a progress display.

    Returns:
        "completed", or "interrupted" after Ctrl and c or SIGTERM.

    Raises:
        TaichisoftError: a step or the controller failed, or an output could not do its job; what was computed
            before is with the outputs.
    """
    scene = simulation.model.scene
    step_count = count_steps(duration if duration is not None else scene.time.duration, scene.time.step)
    begun: list[Output] = []
    errors: list[BaseException] = []
    with held_back() as stop_if_asked:
        try:
            _ask("controller", controller, "reset", simulation.model)
            for output in outputs:
                begun.append(output)
                _ask("output", output, "begin", simulation.model, simulation.state)
            _advance(simulation, controller, outputs, step_count, on_step, stop_if_asked)
            outcome = COMPLETED
        except KeyboardInterrupt:
            outcome = INTERRUPTED
        except BaseException as error:
            outcome = str(error) or type(error).__name__
            errors.append(error)
        errors += _end_all(begun, outcome)
    for later in errors[1:]:
        warnings.warn(str(later), stacklevel=2)
    if errors:
        raise errors[0]
    return outcome


def count_steps(duration: float, time_step: float) -> int:
    """Whole steps in a duration, at least one; both in [s].

    Raises:
        TaichisoftError: the duration is not a positive, finite number.
    """
    if not 0.0 < duration < math.inf:
        raise TaichisoftError(f"duration = {duration:g}: must be a positive, finite number of seconds")
    return max(1, round(duration / time_step))


def _advance(
    simulation: Simulation,
    controller: Controller,
    outputs: Sequence[Output],
    step_count: int,
    on_step: Callable[[StepReport], None] | None,
    stop_if_asked: Callable[[], None],
) -> None:
    warned = False
    for _ in range(step_count):
        stop_if_asked()
        report = simulation.step(_ask("controller", controller, "control", simulation.observe()))
        for output in outputs:
            _ask("output", output, "record", simulation.state, report)
        if not report.converged and not warned:
            warned = True
            contact = simulation.model.scene.contact
            warnings.warn(
                f"step {report.step}: the Gauss-Seidel stopped after {report.iterations} sweeps with a residual of "
                f"{report.residual:.2g} mm/s, above contact.tolerance = {contact.tolerance:g}; "
                "later steps are counted, not reported",
                stacklevel=3,
            )
        if on_step is not None:
            on_step(report)


def _ask(kind: str, plugin: Any, method: str, *arguments: Any) -> Any:
    """Call a method of a controller or output; what it raises unexpectedly is reported with its name."""
    try:
        return getattr(plugin, method)(*arguments)
    except TaichisoftError:
        raise
    except Exception as error:
        name = f"{type(plugin).__module__}.{type(plugin).__qualname__}"
        raise plugin_failure(f"{kind} {name} failed in {method}()", error) from error


def _end_all(outputs: Sequence[Output], outcome: str) -> list[TaichisoftError]:
    """End every output, also when one fails; a missed goal matters less than an output that could not do its job."""
    problems: list[TaichisoftError] = []
    for output in outputs:
        try:
            _ask("output", output, "end", outcome)
        except TaichisoftError as error:
            problems.append(error)
    return sorted(problems, key=lambda problem: isinstance(problem, GoalMissed))
