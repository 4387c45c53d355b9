"""Runs that end far beyond what the law of a body holds for: judged by stretches and by elements inside out."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taichisoft import Control, Controller, Output, Simulation, run
from taichisoft.errors import BeyondLaw, GoalMissed
from taichisoft.scene import scene_from_dict
from taichisoft.step.divergence import StrainWatch


class Inflate(Controller):
    """Asks for one pressure."""

    def __init__(self, pressure: float):
        self.pressure = pressure

    def control(self, observation: Any) -> Control:
        return Control(pressure={"block.air": self.pressure})


class Outcome(Output):
    """Keeps what the run says of itself."""

    said = ""

    def record(self, state: Any, report: Any) -> None:
        pass

    def end(self, outcome: str) -> None:
        self.said = outcome


def simulation(mesh: str, **body: Any) -> Simulation:
    table = {
        "mesh": mesh,
        "density": 1e-6,
        "young_modulus": 100.0,
        "poisson_ratio": 0.3,
        "rayleigh_stiffness": 0.1,
        "cavities": {"air": {"group": "cavity"}},
        **body,
    }
    return Simulation(scene_from_dict({"gravity": [0, 0, 0], "soft_bodies": {"block": table}}))


@pytest.fixture
def hollow(block: Callable[..., str]) -> str:
    return block((4, 4, 4), (20.0, 20.0, 20.0), hollow=True)


def test_twice_the_stretch_of_a_law_is_beyond_it(hollow: str) -> None:
    """Hooke's law holds to 1.2: all elements at 2.3 are allowed, at 2.5 they are not; a single one may come to 4.8."""
    made = simulation(hollow)
    state, watch = made.state, StrainWatch(made.model)
    watch.judge(replace(state, position=2.3 * state.position), None)
    with pytest.raises(BeyondLaw, match=r"'block' was stretched 2\.50-fold, .* Hooke's law holds up to 1\.2"):
        watch.judge(replace(state, position=2.5 * state.position), None)
    position = state.position.copy()
    position[np.argmax(position.sum(axis=1))] *= 2.5  # a corner with six of the 336 elements
    fresh = StrainWatch(made.model)
    with pytest.raises(BeyondLaw, match="1 % of its elements at least"):
        fresh.judge(replace(state, position=position), None)


def test_largest_stretches_count_until_a_restart(hollow: str) -> None:
    made = simulation(hollow)
    state, watch = made.state, StrainWatch(made.model)
    watch.complaint(replace(state, step=20, position=3.0 * state.position))
    with pytest.raises(BeyondLaw):
        watch.judge(state, None)
    watch.restart()
    watch.judge(state, None)


def test_law_without_range_is_judged_by_inverted_elements(hollow: str) -> None:
    """Neo-Hookean rubber has no limit by itself, but at 60 kPa these walls explode: 156 elements end inside out."""
    made, output = simulation(hollow, law="neo-hookean", element="smoothed"), Outcome()
    with (
        pytest.warns(UserWarning, match="elements are inverted"),
        pytest.raises(BeyondLaw, match="elements are inverted at the end"),
    ):
        run(made, Inflate(60.0), [output], duration=0.3)
    assert output.said.startswith("beyond the law: ")
    assert issubclass(BeyondLaw, GoalMissed)  # for the exit code 1 of `taichisoft run`


def test_a_stopped_run_is_judged_too(hollow: str) -> None:
    made = simulation(hollow, law="neo-hookean", element="smoothed")
    from taichisoft import Session
    from taichisoft.running import run_session

    session = Session(made, Inflate(60.0), duration=10.0)
    with pytest.warns(UserWarning, match="elements are inverted"), pytest.raises(BeyondLaw):
        run_session(session, lambda report: session.stop() if report.step == 29 else None)


def test_a_well_behaved_run_completes(hollow: str, tmp_path: Path) -> None:
    assert run(simulation(hollow), Inflate(10.0), [], duration=0.3) == "completed"
