"""A real run of the tiny gripper for the tests of what is made of recordings; it takes a few moments."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import typer
from click.testing import Result
from typer.testing import CliRunner

from taichisoft import Control, Observation, Simulation, State, load_scene
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft_outputs import taichisoft_commands
from taichisoft_outputs.recording.recording_output import RecordingOutput

STEPS = 40
LIFT_AFTER = 30
"""The base rises after so many steps."""


def tiny_run(
    folder: Path,
    overrides: Sequence[str] = (),
    restart_after: int | None = None,
    outputs: Sequence[Any] = (),
    **settings: Any,
) -> list[Observation]:
    """Close on the cube with up to 9 kPa, then rise at 40 mm/s.

    Args:
        folder: gets the recording.
        overrides: of the scene.
        restart_after: so many steps after which everything begins anew.
        outputs: that follow the recording.
        settings: of the recording.

    Returns:
        What was observed in each frame of the recording.
    """
    simulation = Simulation(load_scene(TINY_GRIPPER, overrides))
    outputs = [RecordingOutput(folder, **settings), *outputs]
    first = simulation.state
    for output in outputs:
        output.begin(simulation.model, first)
    observed = [simulation.observe()]
    for count in [restart_after or 0, STEPS]:
        for step in range(count):
            report = simulation.step(_control(step, observed[-1]))
            observed.append(simulation.observe())
            for output in outputs:
                output.record(simulation.state, report)
        if count and count != STEPS:
            simulation.restore(first)
            observed.append(simulation.observe())
            for output in outputs:
                if hasattr(output, "restart"):
                    output.restart(first)
    for output in outputs:
        output.end("completed")
    return observed


def make_run(simulation: Simulation, outputs: Sequence[Any], controls: Iterable[Control]) -> list[State]:
    """Take a simulation and its outputs through a run, and return all its states."""
    states = [simulation.state]
    for output in outputs:
        output.begin(simulation.model, states[0])
    for control in controls:
        report = simulation.step(control)
        states.append(simulation.state)
        for output in outputs:
            output.record(states[-1], report)
    for output in outputs:
        output.end("completed")
    return states


def command(*arguments: object) -> Result:
    """Run `taichisoft` with these arguments, with no other commands than those of this package."""
    application = typer.Typer()
    taichisoft_commands(application)
    return CliRunner().invoke(application, [*map(str, arguments)])


def _control(step: int, observation: Observation) -> Control:
    if step < LIFT_AFTER:
        return Control(pressure=dict.fromkeys(observation.pressure_targets, 9.0 * (step + 1) / LIFT_AFTER))
    return Control(base_velocity=np.array([0.0, 0.0, 40.0]))
