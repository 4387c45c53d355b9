"""The solver for contacts and actuators against the conditions that define the answer, and a simple implementation."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import trimesh
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st

from taichisoft import Simulation
from taichisoft.contact import ContactSolver
from taichisoft.contact.constraint_rows import IMPOSED
from taichisoft.contact.kernels import constraint_problem as kernels
from taichisoft.scene import scene_from_dict


@dataclass
class Problem:
    """v = w impulse + free; three rows per contact, then one per cavity."""

    w: np.ndarray
    free: np.ndarray
    friction: np.ndarray
    start: np.ndarray
    bounds: np.ndarray | None = None
    """Of the rows after the contacts', which are imposed unless this says otherwise."""

    def solve(self, tolerance: float = 1e-12, max_iterations: int = 100_000) -> tuple[np.ndarray, np.ndarray]:
        """Impulses, and the number of sweeps and the residual."""
        contacts, rows, room = len(self.friction), len(self.start), 5  # more room than needed
        arrays = kernels.Problem.without_moments(
            size=np.array([contacts, rows - 3 * contacts, 0], dtype=np.int32),
            compliance=np.concatenate([self.w.reshape(-1), np.full((rows + room) ** 2 - rows**2, np.nan)]),
            free=np.concatenate([self.free, np.full(room, np.nan)]),
            friction=np.concatenate([self.friction, np.full(room, np.nan)]),
            bounds=np.tile(IMPOSED, (rows - 3 * contacts, 1)) if self.bounds is None else self.bounds,
        )
        solver = ContactSolver(arrays)
        solver.impulse[:rows] = self.start
        solver.solve(tolerance, max_iterations)
        return solver.impulse[:rows], np.array([solver.iterations, solver.residual])


def make_problem(seed: int, contacts: int, cavities: int, friction: float) -> Problem:
    """W of random rows over a body of plenty of freedom, so that the answer is unique."""
    random = np.random.default_rng(seed)
    rows = 3 * contacts + cavities
    jacobian = random.normal(size=(rows, 2 * rows))
    start = np.zeros(rows)
    start[3 * contacts :] = random.uniform(0, 1, cavities)
    return Problem(
        w=jacobian @ jacobian.T / (2 * rows),
        free=random.normal(size=rows),
        friction=np.full(contacts, friction),
        start=start,
    )


def simple_sweeps(problem: Problem, sweeps: int) -> np.ndarray:
    """Projected Gauss-Seidel as in the books, without acceleration."""
    impulse, contacts = problem.start.copy(), len(problem.friction)
    for _ in range(sweeps):
        for c in range(contacts):
            n, t = 3 * c, slice(3 * c + 1, 3 * c + 3)
            impulse[n] = max(0.0, impulse[n] - (problem.free[n] + problem.w[n] @ impulse) / problem.w[n, n])
            tangent = problem.free[t] + problem.w[t] @ impulse
            trial = impulse[t] - tangent * 2 / np.trace(problem.w[t, t])
            limit = problem.friction[c] * impulse[n]
            impulse[t] = trial * min(1.0, limit / max(np.linalg.norm(trial), 1e-300))
        for k in range(3 * contacts, len(impulse)):
            impulse[k] -= (problem.free[k] + problem.w[k] @ impulse) / problem.w[k, k]
    return impulse


@examples(60)
@given(
    seed=st.integers(0, 10**6),
    contacts=st.integers(0, 6),
    cavities=st.integers(0, 3),
    friction=st.sampled_from([0.0, 0.1, 0.6]),
)
def test_the_answer_obeys_signorini_and_coulomb(seed: int, contacts: int, cavities: int, friction: float) -> None:
    """0 <= l_n, v_n >= 0, l_n v_n = 0; |l_t| <= mu l_n, and where equal v_t points against l_t, else v_t = 0.

    A cavity ends with no rate of volume left. Tolerance 1e-9:
    what a last change of 1e-12 leaves with a condition number below 1000.
    """
    problem = make_problem(seed, contacts, cavities, friction)
    impulse, outcome = problem.solve()
    assert outcome[1] < 1e-12 or contacts + cavities == 0
    velocity = problem.w @ impulse + problem.free
    for c in range(contacts):
        (push, *pull), (leave, *slip) = impulse[3 * c : 3 * c + 3], velocity[3 * c : 3 * c + 3]
        assert push >= 0.0
        assert leave >= -1e-9
        assert push * leave < 1e-9
        size = np.hypot(*pull)
        assert size <= friction * push * (1 + 1e-12)
        if size < friction * push * (1 - 1e-9):
            assert np.hypot(*slip) < 1e-9
        elif push > 0 and friction > 0:
            assert np.dot(slip, pull) == pytest.approx(-np.hypot(*slip) * size, abs=1e-9)
    for k in range(cavities):
        assert abs(velocity[3 * contacts + k]) < 1e-9


@examples(60)
@given(
    seed=st.integers(0, 10**6),
    contacts=st.integers(0, 3),
    cables=st.lists(
        st.tuples(st.sampled_from(["pull", "tension", "stops"]), st.integers(0, 3)), min_size=1, max_size=3
    ),
    friction=st.sampled_from([0.05, 0.3]),
)
def test_the_answer_obeys_the_bounds_of_actuators(
    seed: int, contacts: int, cables: list[tuple[str, int]], friction: float
) -> None:
    """A cable pulls or is slack, a stop holds or is not reached, a point of friction sticks or loses its share.

    Tolerance 1e-9, as above.
    """
    random, rows = np.random.default_rng(seed), []
    for kind, points in cables:
        preferred, low, high = {"pull": (0.0, 0.0, 0.0), "tension": (0.5, -1e30, 1e30), "stops": (0.5, -0.2, 0.2)}[kind]
        rows.append([preferred, low, high, 0.0, random.uniform(0.1, 3.0) if kind == "pull" else 1e30, -1.0])
        rows += [[0.0, 0.0, 0.0, 0.0, 0.0, np.expm1(friction * random.uniform(0, 1))] for _ in range(points)]
    problem = make_problem(seed, contacts, len(rows), 0.4)
    problem.bounds = np.array(rows)
    impulse, outcome = problem.solve()
    assert outcome[1] < 1e-12
    velocity = (problem.w @ impulse + problem.free)[3 * contacts :]
    before = 0.0
    for (preferred, low, high, lowest, highest, grip), own, rate in zip(
        rows, impulse[3 * contacts :], velocity, strict=True
    ):
        if grip < 0.0:
            assert lowest <= own <= highest
            assert rate > low - 1e-9 or own == highest
            assert rate < high + 1e-9 or own == lowest
            if low + 1e-9 < rate < high - 1e-9:
                assert own == preferred
            before = own
        else:
            assert -grip * before - 1e-12 <= own <= before * grip / (1.0 + grip) + 1e-12
            if rate > 1e-9:  # paid out
                assert own == pytest.approx(-grip * before, abs=1e-9)
            elif rate < -1e-9:
                assert own == pytest.approx(before * grip / (1.0 + grip), abs=1e-9)
            before -= own


@pytest.mark.parametrize("seed", range(5))
def test_the_acceleration_changes_only_the_way(seed: int) -> None:
    """The same answer as plain sweeps, to what 3000 of those leave."""
    problem = make_problem(seed, contacts=5, cavities=2, friction=0.6)
    impulse, outcome = problem.solve()
    assert outcome[0] < 3000
    np.testing.assert_allclose(impulse, simple_sweeps(problem, 3000), atol=1e-9)


def test_half_steps_end_where_friction_lifts_what_the_normal_impulse_presses() -> None:
    """One contact, soft in its normal direction and coupled: 2000 sweeps go to and fro, and the answer is 0.21."""
    problem = make_problem(26840, contacts=1, cavities=1, friction=0.6)
    impulse, outcome = problem.solve()
    assert outcome[1] < 1e-12
    assert impulse[0] == pytest.approx(0.21082845, abs=1e-8)
    assert np.hypot(*impulse[1:3]) == pytest.approx(0.6 * impulse[0])
    assert abs(simple_sweeps(problem, 2000)[0] - impulse[0]) > 0.1


def test_a_newton_step_spares_the_sweeps_that_nearly_equal_contacts_need() -> None:
    """Four contacts in two places a hair apart stick with known impulses: 3000 plain sweeps are off by a tenth."""
    problem = make_problem(7, contacts=4, cavities=0, friction=0.6)
    random = np.random.default_rng(7)
    jacobian = random.normal(size=(12, 24))
    for first in (0, 6):
        jacobian[first + 3 : first + 6] = jacobian[first : first + 3] + 1e-3 * random.normal(size=(3, 24))
    problem.w = jacobian @ jacobian.T / 24
    known = np.array([1.0, 0.1, -0.2, 1.5, 0.3, 0.2, 0.7, 0.2, 0.0, 2.0, -0.5, 0.1])
    problem.free = -problem.w @ known
    impulse, outcome = problem.solve(tolerance=1e-12)
    np.testing.assert_allclose(impulse, known, atol=1e-5)  # 1e-12 and a condition of 1e7
    assert outcome[0] < 30
    assert np.abs(simple_sweeps(problem, 3000) - known).max() > 0.1


def test_stopped_early_it_still_obeys_every_inequality() -> None:
    """The last thing done is a sweep: no pull at a contact, friction inside its cone, and it says that it stopped."""
    problem = make_problem(3, contacts=8, cavities=2, friction=0.4)
    impulse, outcome = problem.solve(max_iterations=4)
    assert outcome[0] == 4
    assert outcome[1] > 1e-12
    normal, tangents = impulse[:24:3], impulse[:24].reshape(-1, 3)[:, 1:]
    assert (normal >= 0.0).all()
    assert (np.linalg.norm(tangents, axis=1) <= 0.4 * normal * (1 + 1e-12)).all()


def test_from_the_answer_it_takes_one_sweep() -> None:
    """A warm start is not thrown away."""
    problem = make_problem(3, contacts=8, cavities=2, friction=0.4)
    problem.start, _ = problem.solve(tolerance=1e-13)
    _, outcome = problem.solve(tolerance=1e-9)
    assert outcome[0] == 1


@pytest.mark.parametrize("friction", [0.0, 0.6])
def test_where_acceleration_restarts_for_ever_plain_sweeps_go_on(friction: float, tmp_path: Path) -> None:
    """A cylinder on 64 contacts, which share its weight in many ways, comes to rest.

    Without a change to plain sweeps, half of these steps were still at 2 to 16 mm/s after 10 000 sweeps.
    """
    trimesh.creation.cylinder(radius=10.0, height=20.0, sections=64).export(tmp_path / "cylinder.stl")
    body = {"surface": str(tmp_path / "cylinder.stl"), "mass": 0.01, "position": [0.0, 0.0, 12.0]}
    floor = {"plane": {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}}
    scene = {"rigid_bodies": {"cylinder": body}, "obstacles": {"floor": floor}}
    contact = {"spacing": 0.0, "friction": friction}
    simulation = Simulation(scene_from_dict({**scene, "contact": contact}))
    reports = [simulation.step() for _ in range(30)]
    assert all(report.converged for report in reports)
    assert max(report.contact_count for report in reports) == 64
    assert np.abs(simulation.state.rigid_velocity).max() < 1e-3
