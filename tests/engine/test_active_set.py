"""Contacts that are left out of the constraint problem at first: the motion must be that of all of them together."""

from collections.abc import Callable

import numpy as np
import pytest

from taichisoft import Simulation
from taichisoft.contact.surfaces import SOFT_GAP_TOLERANCE
from taichisoft.scene import scene_from_dict
from taichisoft.step.constraint_solver import ActiveSet


@pytest.fixture
def simulation(block: Callable[..., str]) -> Simulation:
    """A fast box strikes one at rest, which another step would not have moved, and that one a soft block at a wall."""
    soft = {"mesh": block((2, 2, 2), (10.0, 10.0, 10.0)), "mass": 0.01, "young_modulus": 500, "poisson_ratio": 0.3}
    box = {"box": [10.0, 10.0, 10.0], "mass": 0.05}
    return Simulation(
        scene_from_dict(
            {
                "gravity": [0.0, 0.0, 0.0],
                "soft_bodies": {"block": {**soft, "translation": [0.0, 0.0, 6.5]}},
                "rigid_bodies": {
                    "resting": {**box, "position": [0.0, 0.0, 18.0]},
                    "fast": {**box, "position": [0.0, 0.0, 31.5], "velocity": [0.0, 0.0, -400.0]},
                },
                "obstacles": {"wall": {"plane": {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}}},
            }
        )
    )


def test_the_motion_is_that_of_all_contacts_together(simulation: Simulation, monkeypatch: pytest.MonkeyPatch) -> None:
    start, repeated = simulation.state, []
    add_violated = ActiveSet.add_violated

    def counted(self: ActiveSet, velocity: np.ndarray) -> bool:
        repeated.append(add_violated(self, velocity))
        return repeated[-1]

    def steps() -> list[tuple[np.ndarray, np.ndarray]]:
        simulation.restore(start)
        states = []
        for _ in range(12):
            simulation.step()
            states.append((simulation.state.position, simulation.state.rigid_position))
        return states

    monkeypatch.setattr(ActiveSet, "add_violated", counted)
    few = steps()
    assert any(repeated)  # some contacts were not expected to close

    begin = ActiveSet.begin

    def begin_with_all(self: ActiveSet, *arguments: object) -> None:
        begin(self, *arguments)  # type: ignore[arg-type]
        while self._reduction.add(self.table, ~self.table.is_chosen, self.table.gap, beside=True):
            pass

    monkeypatch.setattr(ActiveSet, "begin", begin_with_all)
    # Contacts that are left out may be closer by the tolerance of the gap, in each of the steps.
    for (soft, rigid), (soft_with_all, rigid_with_all) in zip(few, steps(), strict=True):
        np.testing.assert_allclose(soft, soft_with_all, atol=12 * SOFT_GAP_TOLERANCE)
        np.testing.assert_allclose(rigid, rigid_with_all, atol=12 * SOFT_GAP_TOLERANCE)


def test_contacts_left_out_would_have_been_pierced(simulation: Simulation, monkeypatch: pytest.MonkeyPatch) -> None:
    """The check is what keeps the bodies apart: without it they overlap, with it they do not."""

    def deepest() -> float:
        return max(simulation.step().max_penetration for _ in range(12))

    start = simulation.state
    assert deepest() < 1e-3
    simulation.restore(start)
    monkeypatch.setattr(ActiveSet, "add_violated", lambda *_: False)
    assert deepest() > 0.1
