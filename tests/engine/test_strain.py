"""Stretches of elements: what a run says of bodies beyond their law, and when it is refused."""

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import taichisoft
from taichisoft import Control, Controller, Output, Session, Simulation, run
from taichisoft.errors import BeyondLaw, GoalMissed, SimulationDiverged
from taichisoft.mechanics import Stretches
from taichisoft.mechanics.strain import HOOKE_STRETCH
from taichisoft.running.loop import run_session
from taichisoft.scene import scene_from_dict
from taichisoft.step.divergence import StrainWatch

TETRAHEDRA = np.random.default_rng(3).normal(size=(40, 3)) * 10.0
ELEMENTS = np.arange(40).reshape(-1, 4)


class Inflate(Controller):
    """Requests one pressure."""

    def __init__(self, pressure: float):
        self.pressure = pressure

    def control(self, observation: Any) -> Control:
        return Control(pressure={"block.air": self.pressure})


class Outcome(Output):
    """Keeps what the run says of itself."""

    message = ""

    def record(self, state: Any, report: Any) -> None:
        pass

    def end(self, outcome: str) -> None:
        self.message = outcome


@pytest.fixture
def hollow(block: Callable[..., str]) -> str:
    return block((4, 4, 4), (20.0, 20.0, 20.0), hollow=True)


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
    scene = {"gravity": [0, 0, 0], "time": {"duration": 1.0}, "soft_bodies": {"block": table}}
    return Simulation(scene_from_dict(scene))


def warnings_of(call: Callable[[], Any]) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        call()
    return [str(warning.message) for warning in caught]


@examples(60)
@given(seed=st.integers(0, 10**6), size=st.floats(0.0, 2.0))
def test_largest_stretch_is_the_largest_singular_value(seed: int, size: float) -> None:
    """Of x = F X + t, turned at random, for any F; tolerance 1e-7: where two stretches are equal, half the digits."""
    generator = np.random.default_rng(seed)
    deformation = np.eye(3) + size * generator.uniform(-1, 1, (3, 3))
    turned = Rotation.random(rng=generator).as_matrix() @ deformation
    found = Stretches(TETRAHEDRA, ELEMENTS).largest(TETRAHEDRA @ turned.T + 5.0)
    np.testing.assert_allclose(found, np.linalg.svd(deformation)[1][0], rtol=1e-7)


@pytest.mark.parametrize("stretch", [(1.0, 1.0, 1.0), (1.5, 1.5, 1.0), (1.5, 1.0, 1.0), (0.0, 0.0, 0.0)])
def test_equal_stretches_are_found(stretch: tuple[float, float, float]) -> None:
    found = Stretches(TETRAHEDRA, ELEMENTS).largest(TETRAHEDRA * stretch)
    np.testing.assert_allclose(found, max(stretch), atol=1e-7)


def test_range_of_hookes_law_is_as_documented() -> None:
    """E (l - 1) over E (l - l^-2) / 3, the force of neo-Hookean rubber of equal moduli: 1.19 at 1.2, 1.71 at 2."""
    for stretch, ratio in ((HOOKE_STRETCH, 1.187), (2.0, 1.714)):
        assert 3.0 * (stretch - 1.0) / (stretch - stretch**-2) == pytest.approx(ratio, abs=1e-3)


def test_run_warns_once_of_a_body_beyond_its_law(hollow: str) -> None:
    """Which body, how far, where and when; and nothing while the stretch is below 1.2."""
    assert warnings_of(lambda: run(simulation(hollow), Inflate(5.0), [])) == []
    (line,) = warnings_of(lambda: run(simulation(hollow), Inflate(15.0), []))
    assert line.startswith("'block' is stretched 1.")
    assert "-fold at (" in line and "Hooke's law holds up to 1.2" in line
    assert "\n" not in line


def test_steps_and_equilibria_warn_without_a_run(hollow: str) -> None:
    """Once, and their results have the largest stretch over that of the law."""
    made = simulation(hollow, anchors=[{"box": [[-11, -11, -11], [11, 11, -9.9]]}])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        at_rest = taichisoft.equilibrium(made, Control(pressure={"block.air": 5.0}))
        assert not caught and 0.5 < at_rest.stretch_over_law["block"] < 1.0
        reports = [made.step(Control(pressure={"block.air": 20.0})) for _ in range(60)]
        found = taichisoft.equilibrium(made)
    (line,) = (str(warning.message) for warning in caught)
    assert line.startswith("'block' is stretched 1.") and "Hooke's law holds up to 1.2" in line
    largest = Stretches(made.model.rest_position, made.model.soft_bodies[0].elements)
    assert reports[-1].stretch_over_law == {"block": largest.largest(made.state.position).max() / HOOKE_STRETCH}
    assert found.stretch_over_law["block"] > 1.0


def test_divergence_by_large_strain_names_the_law(hollow: str) -> None:
    made = simulation(hollow)
    with pytest.raises(SimulationDiverged, match=r"Hooke's law holds up to 1\.2"):
        for step in range(400):
            made.step(Control(pressure={"block.air": 2.0 * step}))


@pytest.mark.parametrize(("ratio", "warned"), [(0.45, False), (0.46, True)])
def test_linear_elements_that_lock_are_warned_of(hollow: str, ratio: float, warned: bool) -> None:
    """At loading; the line names the key and the remedy."""
    lines = warnings_of(lambda: simulation(hollow, poisson_ratio=ratio, element="linear"))
    assert len(lines) == warned
    if warned:
        assert lines[0].startswith("soft_bodies.block.poisson_ratio = 0.46: linear elements lock above 0.45")
        assert 'element = "smoothed"' in lines[0]


def test_twice_the_stretch_of_a_law_is_beyond_it(hollow: str) -> None:
    """Hooke's law holds to 1.2: all elements at 2.3 are allowed, at 2.5 they are not; a single one may come to 4.8."""
    made = simulation(hollow)
    state, watch = made.state, StrainWatch(made.model)
    watch.judge(replace(state, position=2.3 * state.position), None)
    with pytest.raises(BeyondLaw, match=r"'block' was stretched 2\.50-fold, .* Hooke's law holds up to 1\.2"):
        watch.judge(replace(state, position=2.5 * state.position), None)
    position = state.position.copy()
    position[np.argmax(position.sum(axis=1))] *= 2.5  # a corner with six of the 336 elements
    with pytest.raises(BeyondLaw, match="1 % of its elements at least"):
        StrainWatch(made.model).judge(replace(state, position=position), None)


def test_largest_stretches_count_until_a_restart(hollow: str) -> None:
    made = simulation(hollow)
    state, watch = made.state, StrainWatch(made.model)
    watch.complaint(replace(state, step=20, position=3.0 * state.position))
    with pytest.raises(BeyondLaw):
        watch.judge(state, None)
    watch.restart()
    watch.judge(state, None)


def test_law_without_range_is_judged_by_inverted_elements(hollow: str) -> None:
    """Neo-Hookean rubber has no limit by itself, but at 60 kPa these walls explode: 156 elements end inside out.

    A run that is stopped is judged, too; at 10 kPa a run completes.
    """
    rubber, output = {"law": "neo-hookean", "element": "smoothed"}, Outcome()
    with (
        pytest.warns(UserWarning, match="elements are inverted"),
        pytest.raises(BeyondLaw, match="elements are inverted at the end"),
    ):
        run(simulation(hollow, **rubber), Inflate(60.0), [output], duration=0.3)
    assert output.message.startswith("beyond the law: ")
    assert issubclass(BeyondLaw, GoalMissed)  # for the exit code 1 of `taichisoft run`
    session = Session(simulation(hollow, **rubber), Inflate(60.0), duration=10.0)
    with pytest.warns(UserWarning, match="elements are inverted"), pytest.raises(BeyondLaw):
        run_session(session, lambda report: session.stop() if report.step == 29 else None)
    assert run(simulation(hollow), Inflate(10.0), [], duration=0.3) == "completed"
