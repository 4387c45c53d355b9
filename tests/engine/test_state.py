"""A state is a value: copied, compared, saved and restored whole."""

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from taichisoft import Control, Simulation, State
from taichisoft.errors import StateError
from taichisoft.scene import scene_from_dict


@pytest.fixture
def simulation(block: Callable[..., str]) -> Simulation:
    """A hollow block on the floor under pressure, held loosely, a box on it, and a block on a tank, after two steps."""
    body = {
        "mesh": block((3, 3, 3), (20.0, 20.0, 20.0), hollow=True),
        "mass": 0.01,
        "young_modulus": 500,
        "poisson_ratio": 0.3,
        "translation": [0, 0, 11],
        "anchors": [{"box": [[-10, -10, 10], [10, 10, 10]], "stiffness": 1.0}],
        "cavities": {"air": {"group": "cavity", "air": "line", "line": {"conductance": 1.0, "delay": 0.01}}},
        "cables": {"tendon": {"points": [[-8, 9, -9], [0, 9, -8], [8, 9, -9]], "friction": 0.1}},
    }
    apart = {"translation": [60, 0, 11], "cables": {}, "cavities": {"air": {"group": "cavity", "air": "network"}}}
    air = {
        "tanks": {"tank": {"volume": 100.0}},
        "valves": {"valve": {"inlet": "tank", "outlet": "apart.air", "conductance": 0.1, "delay": 0.02}},
    }
    box = {"box": [10, 10, 10], "mass": 0.01, "position": [0, 0, 27]}
    floor = {"plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}
    bodies = {"block": body, "apart": body | apart}
    scene = {"soft_bodies": bodies, "air": air, "rigid_bodies": {"box": box}, "obstacles": {"floor": floor}}
    scene["sensors"] = {"pressure": {"delay": 0.01}}
    simulation = Simulation(scene_from_dict(scene))
    for _ in range(2):
        turn = np.array([0.1, 0.2, 0.3])
        simulation.step(Control(pressure={"block.air": 5.0}, cable_pull={"block.tendon": 0.1}, base_rotation=turn))
    assert len(simulation.state.contact_body_pair)
    return simulation


def test_a_copy_is_equal_and_shares_nothing(simulation: Simulation) -> None:
    copy = simulation.state.copy()
    assert copy == simulation.state
    for field in fields(State):
        value = getattr(copy, field.name)
        if isinstance(value, np.ndarray):
            assert not np.shares_memory(value, getattr(simulation.state, field.name))


def test_states_differ_when_any_bit_does(simulation: Simulation) -> None:
    for name in (field.name for field in fields(State)):
        value = getattr(simulation.state, name)
        if name == "actuator_imposed":
            other = ~value
        else:
            other = np.nextafter(value, np.inf) if np.asarray(value).dtype == float else value + 1
        assert replace(simulation.state, **{name: other}) != simulation.state, name


def test_a_step_leaves_the_old_state_untouched(simulation: Simulation) -> None:
    before = simulation.state
    kept = before.copy()
    simulation.step(Control(pressure={"block.air": 50.0}, base_translation=np.ones(3)))
    assert before == kept
    assert simulation.state != kept


def test_an_earlier_state_can_be_gone_back_to(simulation: Simulation) -> None:
    start = simulation.state
    simulation.step()
    first = simulation.state
    simulation.step()
    simulation.state = start
    simulation.step()
    assert simulation.state == first


def test_what_is_saved_comes_back_bit_for_bit(simulation: Simulation, tmp_path: Path) -> None:
    simulation.state.save(tmp_path / "state.npz")
    loaded = State.load(tmp_path / "state.npz")
    assert loaded == simulation.state
    for field in fields(State):
        assert type(getattr(loaded, field.name)) is type(getattr(simulation.state, field.name))


def test_file_that_is_no_state_is_refused(simulation: Simulation, tmp_path: Path) -> None:
    """In one line: a missing file, others, a state cut short, and arrays of something else."""
    path = tmp_path / "bad.npz"
    simulation.state.save(path)
    whole = path.read_bytes()
    path.unlink()
    for content in (None, b"", b"no zip file", b"PK\x03\x04 begins like one", whole[: len(whole) // 2], whole[:-10]):
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(StateError, match=r"bad\.npz: cannot be read as a state: [^\n]+$"):
            State.load(path)
    np.save(tmp_path / "single.npy", np.zeros(3))
    with pytest.raises(StateError, match=r"single\.npy: cannot be read as a state"):
        State.load(tmp_path / "single.npy")
    np.savez(tmp_path / "other.npz", position=np.zeros(3), colour=np.zeros(3))
    with pytest.raises(StateError, match=r"not a state of this version of taichisoft; it differs in: .*colour"):
        State.load(tmp_path / "other.npz")


def test_a_state_of_another_model_does_not_fit(simulation: Simulation) -> None:
    simulation.model.check(simulation.state)
    smaller = replace(simulation.state, position=simulation.state.position[1:])
    with pytest.raises(StateError, match=r"another model: its position has shape \(127, 3\), the model's \(128, 3\)"):
        simulation.model.check(smaller)
