"""The loop around the step: controller, step, outputs. The only place that calls plug-ins while a run goes on."""

import warnings
from collections.abc import Callable, Sequence

from taichisoft.controller import Controller
from taichisoft.errors import TaichisoftError
from taichisoft.output import Output
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
        "completed", or "interrupted" after Ctrl and c.

    Raises:
        TaichisoftError: a step or the controller failed, or an output could not do its job; what was computed
            before is with the outputs.
    """
    scene = simulation.model.scene
    step_count = count_steps(duration if duration is not None else scene.time.duration, scene.time.step)
    begun: list[Output] = []
    outcome = "failed"
    try:
        controller.reset(simulation.model)
        for output in outputs:
            begun.append(output)
            output.begin(simulation.model, simulation.state)
        _advance(simulation, controller, outputs, step_count, on_step)
        outcome = COMPLETED
    except KeyboardInterrupt:
        outcome = INTERRUPTED
    except Exception as error:
        outcome = str(error) or type(error).__name__
        raise
    finally:
        problems = _end_all(begun, outcome)
    if problems:
        raise problems[0]
    return outcome


def count_steps(duration: float, time_step: float) -> int:
    """Whole steps in a duration, at least one; both in [s]."""
    return max(1, round(duration / time_step))


def _advance(
    simulation: Simulation,
    controller: Controller,
    outputs: Sequence[Output],
    step_count: int,
    on_step: Callable[[StepReport], None] | None,
) -> None:
    warned = False
    for _ in range(step_count):
        report = simulation.step(controller.control(simulation.observe()))
        for output in outputs:
            output.record(simulation.state, report)
        if not report.converged and not warned:
            warned = True
            contact = simulation.model.scene.contact
            warnings.warn(
                f"step {report.step}: the Gauss-Seidel stopped after {report.iterations} sweeps with a residual of "
                f"{report.residual:.2g} mm/s, above contact.tolerance = {contact.tolerance:g}; "
                "later steps are counted, not reported",
                stacklevel=2,
            )
        if on_step is not None:
            on_step(report)


def _end_all(outputs: Sequence[Output], outcome: str) -> list[TaichisoftError]:
    """End every output, also when one fails; a failure that is no TaichisoftError is wrapped with its output's name."""
    problems: list[TaichisoftError] = []
    for output in outputs:
        try:
            output.end(outcome)
        except TaichisoftError as error:
            problems.append(error)
        except Exception as error:
            name = type(output).__name__
            wrapped = TaichisoftError(f"output {name} failed when the run ended: {error}")
            wrapped.__cause__ = error
            problems.append(wrapped)
    return problems
