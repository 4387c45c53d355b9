"""Overdamped dynamics: every node moves against a drag of its mass times 1/s, and nothing has inertia."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import Figures
from scenes import FLOOR, GRAVITY, advance, silicone

from taichisoft import Control, Simulation, VolumeMesh, write_volume_mesh
from taichisoft.scene import scene_from_dict

DOWN = [0.0, 0.0, -GRAVITY]
CUBE = (20.0, 20.0, 20.0)


def overdamped(gravity: list[float], step: float = 0.01, dynamics: str = "overdamped", **tables: object) -> Simulation:
    return Simulation(scene_from_dict({"gravity": gravity, "time": {"step": step, "dynamics": dynamics}, **tables}))


@pytest.mark.parametrize("step", [0.001, 0.01, 0.1])
def test_a_block_on_springs_relaxes_exponentially(block: Callable[..., str], figures: Figures, step: float) -> None:
    """x -> m g / k with the rate k / m, whatever the block's elasticity, velocity at the start and Rayleigh damping.

    Every node has the mass m and a spring k: m x' = m g - k x. A step of implicit Euler multiplies the distance from
    the end by exactly 1 / (1 + h k / m), to round-off; the exponential function by exp(-h k / m), which differs by
    (h k / m)^2 / 2 in a step, summed to h k / (2 e m) at most.
    """
    mesh, mass, rate, gravity = block((2, 2, 2), CUBE), 0.01, 2.0, 500.0
    stiffness = rate * mass / 27
    body = silicone(mesh, density=None, mass=mass, rayleigh_mass=3.0, velocity=[5.0, 0.0, 40.0])
    body["anchors"] = [{"box": [[-10, -10, -10], [10, 10, 10]], "stiffness": stiffness}]
    simulation = overdamped([0.0, 0.0, -gravity], step, soft_bodies={"block": body})
    rest, end = simulation.model.rest_position, -gravity / rate
    miss_of_step = miss_of_law = 0.0
    for count in range(1, 21):
        simulation.step()
        moved = simulation.state.position - rest
        miss_of_step = max(miss_of_step, np.abs(moved[:, 2] - end * (1 - (1 + step * rate) ** -count)).max())
        miss_of_law = max(miss_of_law, np.abs(moved[:, 2] - end * (1 - np.exp(-rate * step * count))).max())
        assert np.abs(moved[:, :2]).max() < 1e-8
    figures.at_most("implicit Euler [mm]", miss_of_step, 1e-7)
    figures.at_most("exponential, of m g / k and of h k / m", miss_of_law / -end / (step * rate), 0.5 / np.e)


def test_what_is_free_falls_at_a_speed_of_g_times_a_second(block: Callable[..., str]) -> None:
    """M v = M g, from the first step on and for ever."""
    simulation = overdamped(DOWN, soft_bodies={"block": silicone(block((2, 2, 2), CUBE))})
    for _ in range(3):
        simulation.step()
        np.testing.assert_allclose(simulation.state.velocity, np.tile(DOWN, (27, 1)), atol=1e-6)


def test_the_end_is_that_of_newtons_law(block: Callable[..., str], figures: Figures) -> None:
    """A bar that hangs from its end face: mass and drag matter on the way, not where it comes to rest."""
    bar = silicone(block((6, 2, 2), (60.0, 10.0, 10.0)), young_modulus=40, rayleigh_mass=20.0)
    bar["anchors"] = [{"box": [[-30, -5, -5], [-30, 5, 5]]}]
    first, second = (
        overdamped([1000.0, 0.0, -500.0], 0.02, dynamics, soft_bodies={"bar": bar})
        for dynamics in ("overdamped", "inertial")
    )
    advance(first, 2.0)
    advance(second, 20.0)
    largest = np.abs(first.state.position - first.model.rest_position).max()
    assert largest > 0.5
    apart = np.abs(first.state.position - second.state.position).max()
    figures.at_most("ends apart, of the largest displacement", apart / largest, 1e-7)


def test_a_volume_takes_the_pressure_that_gives_it(block: Callable[..., str], figures: Figures) -> None:
    """A cavity grown by 50 mm^3 has a pressure as a result, which as an imposed one makes it grow by 50 mm^3."""
    body = silicone(block((4, 4, 4), CUBE, hollow=True), cavities={"air": {"group": "cavity"}})
    body["anchors"] = [{"box": [[-10, -10, -10], [10, 10, -10]]}]
    by_volume, by_pressure = (overdamped([0.0, 0.0, 0.0], soft_bodies={"block": body}) for _ in range(2))
    report = advance(by_volume, 1.0, Control(volume_growth={"block.air": 50.0}))
    pressure = report.observation.pressures["block.air"]
    assert pressure > 1.0
    report = advance(by_pressure, 1.0, Control(pressure={"block.air": pressure}))
    growth = report.observation.volumes["block.air"] - by_pressure.model.cavities.rest_value[0]
    figures.close("growth [mm^3]", growth, 50.0, 1e-6)


def test_the_floor_carries_the_weight(block: Callable[..., str], figures: Figures) -> None:
    """A block sinks onto a plane; at rest the contact forces are its weight, and the impulses h times that."""
    body = silicone(block((2, 2, 2), CUBE), translation=[0.0, 0.0, 12.0])
    simulation = overdamped(DOWN, soft_bodies={"block": body}, obstacles={"floor": FLOOR})
    report = advance(simulation, 0.5)
    weight = 1e-6 * 20.0**3 * GRAVITY
    figures.close("contact force [mN]", report.contact_forces[:, 2].sum(), -weight, 1e-6 * weight)
    figures.at_most("velocity at rest [mm/s]", np.abs(simulation.state.velocity).max(), 1e-4)


def test_a_cable_finger_sags_as_in_sofa(shared: Path, figures: Figures, tmp_path: Path) -> None:
    """SOFA v25.06, EulerImplicitSolver with firstOrder, before the cable of the scene is pulled: every node and step.

    Tolerance 1e-6 of the largest displacement, as for the other runs of SOFA.
    """
    path = shared / "reference" / "sofa-cables" / "b_CableForce.npz"
    if not path.is_file():
        pytest.skip("the recorded runs of SOFA with cables are not there")
    run = np.load(path)
    write_volume_mesh(VolumeMesh("finger", run["finger_rest"], run["finger_tets"]), tmp_path / "finger.msh")
    body = {"mesh": str(tmp_path / "finger.msh"), "mass": 0.5, "young_modulus": 18000.0, "poisson_ratio": 0.3}
    body |= {"element": "linear", "corotation": "edges"}  # SOFA's method "large"
    anchors = {"nodes": run["finger_fixed_rss"].tolist(), "stiffness": float(run["finger_rss_stiffness"][0])}
    simulation = overdamped(
        run["gravity"].tolist(), float(run["dt"]), soft_bodies={"finger": {**body, "anchors": [anchors]}}
    )
    pulled = int(np.flatnonzero(run["finger_cable_value"])[0])
    assert pulled == 20
    largest = np.abs(run["finger_x"][pulled - 1] - run["finger_rest"]).max()
    for recorded in run["finger_x"][:pulled]:
        simulation.step()
        miss = np.abs(simulation.state.position - recorded).max()
        figures.at_most("of the largest displacement", miss / largest, 1e-6)
