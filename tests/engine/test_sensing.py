"""Sensors of a scene stand between the simulation and its controllers, and go on with the same bits."""

from dataclasses import fields
from typing import Any, get_args

import numpy as np
import pytest

import taichisoft
from taichisoft import Control, Observation, Simulation, State, load_scene
from taichisoft.control import SensorChain
from taichisoft.errors import SceneError
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.scene import SensorSettings
from taichisoft.scene.sensor_settings import SensedQuantity

SIZE = 4000
OBSERVED = [one.name for one in fields(Observation) if one.name not in ("exact", "state", "cameras")]


def chain(size: int = SIZE, **settings: Any) -> SensorChain:
    return SensorChain(SensorSettings(**settings), 0.01, size, "pressure")


def readings(sensor: SensorChain, values: np.ndarray, first_step: int = 0) -> np.ndarray:
    """What a sensor shows of rows of values."""
    samples, shown = sensor.begin(values[0], first_step, 5), []
    for step, row in enumerate(values, first_step):
        samples = samples if step == first_step else sensor.after(samples, row, step, 5)
        shown.append(sensor.reading(samples, step))
    return np.array(shown)


def test_noise_and_bias_have_the_size_that_the_scene_says() -> None:
    """Of 4000 numbers a mean is known to s / sqrt(4000), a deviation to s / sqrt(8000); bounds are 5 of these."""
    noise = readings(chain(noise=2.0), np.zeros((2, SIZE)))
    assert np.abs(noise.mean(axis=1)).max() < 5 * 2.0 / np.sqrt(SIZE)
    assert np.abs(noise.std(axis=1) - 2.0).max() < 5 * 2.0 / np.sqrt(2 * SIZE)
    assert abs(np.corrcoef(noise)[0, 1]) < 5 / np.sqrt(SIZE)
    bias = readings(chain(bias=3.0), np.zeros((3, SIZE)))
    assert (bias == bias[0]).all() and np.abs(bias).max() <= 3.0
    # Even between -b and b: the variance is b^2 / 3.
    assert bias[0].std() == pytest.approx(3.0 / np.sqrt(3.0), rel=0.05)


def test_a_reading_is_a_whole_multiple_of_the_resolution() -> None:
    values = np.random.default_rng(0).uniform(-9.0, 9.0, (1, SIZE))
    shown = readings(chain(resolution=0.5), values)
    assert np.array_equal(shown / 0.5, np.rint(shown / 0.5)) and np.abs(shown - values).max() <= 0.25


@pytest.mark.parametrize("first", [0, 7])
@pytest.mark.parametrize(("period", "delay"), [(0, 0), (1, 3), (4, 0), (4, 3), (3, 8)])
def test_a_reading_is_the_last_sample_that_is_old_enough(period: int, delay: int, first: int) -> None:
    """At step s it is the sample of step floor((s - delay) / period) * period, and the first value before."""
    values = np.arange(first, first + 30.0)[:, None]
    sensor = chain(1, period=0.01 * period, delay=0.01 * delay)
    every = max(period, 1)
    expected = [max(float((step - delay) // every * every), first) for step in range(first, first + 30)]
    assert readings(sensor, values, first)[:, 0].tolist() == expected


def test_a_lost_sample_is_the_one_before() -> None:
    values = np.arange(1.0, 4.0)[:, None] * np.ones(SIZE)
    shown = readings(chain(dropout=0.25), values)
    lost = shown[1] == 1.0
    assert set(shown[1]) == {1.0, 2.0} and lost.mean() == pytest.approx(0.25, abs=0.03)
    assert set(shown[2][lost]) == {1.0, 3.0} and set(shown[2][~lost]) == {2.0, 3.0}


SENSORS = [
    "sensors.pressure={noise=0.2, bias=0.5, delay=0.02}",
    "sensors.normal_force={noise=3.0, period=0.03, dropout=0.2}",
    "sensors.object_position={resolution=0.25}",
    "sensors.base_force={noise=1.0}",
]


def gripper(*changes: str) -> Simulation:
    return Simulation(load_scene(TINY_GRIPPER, [*SENSORS, *changes]))


def close(simulation: Simulation, steps: int) -> list[Observation]:
    asked = Control(pressure={"left.cavity": 8.0, "right.cavity": 8.0})
    seen = []
    for _ in range(steps):
        simulation.step(asked)
        seen.append(simulation.observe())
    return seen


def shown(seen: list[Observation]) -> list[Any]:
    """What sensors made of the pressures, of an angle of the base force and of the forces on the cube."""
    return [
        (dict(one.pressures), one.base_force_in_base.tolist(), dict(one.normal_forces), one.object_positions["cube"][0])
        for one in seen
    ]


def test_controllers_see_what_sensors_show_and_can_have_the_truth(tmp_path: Any) -> None:
    exact, disturbed = Simulation(load_scene(TINY_GRIPPER)), gripper()
    truths, seen = close(exact, 12), close(disturbed, 12)
    for truth, one in zip(truths, seen, strict=True):
        assert one.truth.pressures == truth.pressures and one.truth.exact is None
        assert np.array_equal(one.tip_positions["left"], truth.tip_positions["left"])  # has no sensor
        assert one.pressures != truth.pressures
        assert one.object_positions["cube"].tolist() == (0.25 * np.rint(4 * truth.object_positions["cube"])).tolist()
        assert np.allclose(one.base_force, one.base_force_in_base)  # the base is not turned
        assert one.normal_forces["left", "cube"] != 0.0
    assert disturbed.report is not None
    reported = disturbed.report.observation
    assert shown([reported]) == shown(seen[-1:]) and reported.truth.pressures == truths[-1].pressures

    # A run that goes on from a state, saved in the middle of delays and samples, has the same bits.
    fresh = gripper()
    close(fresh, 5)
    fresh.state.save(tmp_path / "state.npz")
    later = gripper()
    later.restore(State.load(tmp_path / "state.npz"))
    assert shown(close(later, 7)) == shown(seen[5:])
    assert later.state == disturbed.state
    assert shown(close(gripper("sensors.pressure.seed=1"), 1)) != shown(seen[:1])


@pytest.mark.parametrize(
    "quantity", [one for one in get_args(SensedQuantity) if not one.startswith(("cable_", "network_"))]
)
def test_every_quantity_has_its_sensor(quantity: str) -> None:
    pad = "soft_bodies.left.tactile.pad={box=[[-99,-99,-99],[99,99,99]], patches=[2,1,1]}"
    simulation = Simulation(load_scene(TINY_GRIPPER, [f"sensors.{quantity}={{bias=0.5}}", pad]))
    (one,) = close(simulation, 1)
    plain = {name: [getattr(seen, name) for seen in (one, one.truth)] for name in OBSERVED}
    assert [name for name, (seen, exact) in plain.items() if str(seen) != str(exact)]


def test_equilibrium_was_seen_by_sensors_for_long() -> None:
    """A delay has passed where bodies rest, and derivatives are those of the exact figures."""
    asked = Control(pressure={"left.cavity": 4.0})
    late = "sensors={pressure={delay=0.1}, tip_position={delay=0.1, noise=0.5}}"
    exact, delayed = Simulation(load_scene(TINY_GRIPPER)), Simulation(load_scene(TINY_GRIPPER, [late]))
    plain, found = (taichisoft.equilibrium(one, asked) for one in (exact, delayed))
    assert found.observation.pressures["left.cavity"] == plain.observation.pressures["left.cavity"] == 4.0
    tips = [one["tip_positions.left"] for one in (plain.linearise(), found.linearise())]
    assert np.array_equal(*tips) and np.abs(tips[0]).max() > 0.0


def test_a_state_of_other_sensors_begins_them_anew() -> None:
    plain = Simulation(load_scene(TINY_GRIPPER))
    close(plain, 3)
    simulation = gripper()
    simulation.restore(plain.state)
    pressure = simulation.observe().pressures["left.cavity"]
    assert 0.0 < abs(pressure - plain.observe().pressures["left.cavity"]) < 0.5 + 5 * 0.2


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ("sensors.presure={noise=1.0}", "sensors.presure: unknown name; did you mean 'pressure'?"),
        ("sensors.pressure={noise=-1.0}", "sensors.pressure.noise"),
        ("sensors.pressure={noise=nan}", "sensors.pressure.noise"),
        ("sensors.pressure={dropout=1.5}", "sensors.pressure.dropout"),
        ("sensors.pressure={delay=0.015}", "delay = 0.015 s must be a whole multiple of time.step = 0.01 s"),
        ("sensors.pressure={period=0.001}", "period = 0.001 s must be a whole multiple"),
        ("sensors.pressure={delay=20.0}", "sensors.pressure.delay"),
        ("sensors.cable_pull={noise=1.0}", "sensors.cable_pull measures nothing"),
        ("sensors.tactile={noise=1.0}", "sensors.tactile measures nothing"),
        ("soft_bodies.left.tactile.pad={box=[[0,0,0],[0,1,1]], patches=[1,1,1]}", "first corner must be below"),
        ("soft_bodies.left.tactile.pad={box=[[0,0,0],[1,1,1]], patches=[0,1,1]}", "patches.0"),
    ],
)
def test_sensors_that_make_no_sense_are_refused(change: str, problem: str) -> None:
    with pytest.raises(SceneError, match=problem):
        load_scene(TINY_GRIPPER, [change])
