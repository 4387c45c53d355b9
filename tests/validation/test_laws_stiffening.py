"""Young's modulus that changes while a run goes on: from then on the body is one of that modulus."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import Figures
from scenes import GRAVITY, advance, silicone, simulate

from taichisoft import Control, Simulation, State

LENGTH = 40.0
AGREEMENT = 1e-9
"""Of positions [mm], of runs that differ by round-off in their stiffness."""


@pytest.fixture
def bar(block: Callable[..., str]) -> Callable[..., Simulation]:
    """Makes a bar that hangs from its upper end, its lower half of another silicone."""

    def make(
        upper: float = 50.0, lower: float = 50.0, corotation: str = "polar", dynamics: str = "inertial"
    ) -> Simulation:
        table = silicone(
            block((2, 2, 4), (10.0, 10.0, LENGTH)),
            young_modulus=upper,
            regions=[{"box": [[-5, -5, -20], [5, 5, 0]], "young_modulus": lower, "poisson_ratio": 0.4}],
            anchors=[{"box": [[-5, -5, 19.9], [5, 5, 20]]}],
            element="linear",
            corotation=corotation,
            rayleigh_mass=20.0,
        )
        time = {"step": 0.01, "dynamics": dynamics}
        return simulate(gravity=(0.0, 0.0, -GRAVITY), soft_bodies={"bar": table}, time=time)

    return make


def both(modulus: float) -> Control:
    return Control(young_modulus={"bar": modulus, "bar.regions.0": modulus})


def elongation(simulation: Simulation) -> float:
    """How far the lower end has sunk in the mean [mm]."""
    rest, position = simulation.model.rest_position, simulation.state.position
    return float((rest - position)[rest[:, 2] < -0.49 * LENGTH, 2].mean())


@pytest.mark.parametrize("dynamics", ["inertial", "overdamped"])
def test_elongation_under_its_weight_is_inverse_to_the_modulus(
    bar: Callable[..., Simulation], figures: Figures, dynamics: str
) -> None:
    """Exactly so in a linear law. The strain, 0.2 % at 50 kPa, changes polar rotations and lengths in its square: 1 %
    is five times that."""
    simulation = bar(dynamics=dynamics)
    advance(simulation, 2.0)
    soft = elongation(simulation)
    for times in (4.0, 0.5, 10.0):
        advance(simulation, 2.0, both(50.0 * times))
        figures.close(f"times stiffness {times:g}", elongation(simulation), soft / times, 0.01 * soft / times)
    advance(simulation, 2.0, both(50.0))
    figures.close("as at first [mm]", elongation(simulation), soft, AGREEMENT)


@pytest.mark.parametrize("corotation", ["edges", "polar"])
def test_motion_is_that_of_a_run_which_began_with_the_modulus(
    bar: Callable[..., Simulation], figures: Figures, corotation: str
) -> None:
    """From the first step on, of the body and of a region alone, all matrices and forces being the same."""
    changed, begun = bar(50.0, 80.0, corotation=corotation), bar(20.0, 320.0, corotation=corotation)
    control = Control(young_modulus={"bar": 20.0, "bar.regions.0": 320.0})
    for _ in range(30):
        changed.step(control)
        begun.step()
    difference = np.abs(changed.state.position - begun.state.position).max()
    figures.at_most("difference of positions [mm]", difference, AGREEMENT)
    assert elongation(begun) > 0.05


def test_the_modulus_of_a_scene_gives_the_bits_of_the_scene(bar: Callable[..., Simulation]) -> None:
    """Also after another one; `first` differs from `second` in nothing but what it was asked for in between."""
    first, second = bar(), bar()
    start = first.state
    first.step(both(300.0))
    first.restore(start)
    for _ in range(5):
        first.step(both(50.0))
        second.step()
    assert first.state == second.state


def test_a_run_goes_on_with_its_modulus(bar: Callable[..., Simulation], tmp_path: Path) -> None:
    """To the bit, in a simulation that knows it from a file alone."""
    simulation = bar()
    simulation.step(Control(young_modulus={"bar.regions.0": 10.0}))
    simulation.state.save(tmp_path / "state.npz")
    other = Simulation(simulation.model)
    other.step(both(7.0))
    other.restore(State.load(tmp_path / "state.npz"))
    for _ in range(5):
        simulation.step()
        other.step()
    assert other.state == simulation.state
    assert other.state.young_modulus.tolist() == [50.0, 10.0]


def test_the_later_of_two_regions_wins(block: Callable[..., str]) -> None:
    """Elements belong to the last region that selects them: to change the one below changes nothing there."""
    everywhere = {"box": [[-50, -50, -50], [50, 50, 50]], "young_modulus": 100.0}
    table = silicone(block((1, 1, 1), (10.0, 10.0, 10.0)), regions=[everywhere, {**everywhere, "young_modulus": 200.0}])
    simulation, other = (simulate(soft_bodies={"cube": table}) for _ in range(2))
    model = simulation.model
    assert model.material_names == ("cube", "cube.regions.0", "cube.regions.1")
    assert model.young_modulus.tolist() == [500.0, 100.0, 200.0]
    assert (model.element_material == 2).all()
    simulation.step(Control(young_modulus={"cube": 1.0, "cube.regions.0": 1.0}))
    other.step()
    assert simulation.state.position.tobytes() == other.state.position.tobytes()
