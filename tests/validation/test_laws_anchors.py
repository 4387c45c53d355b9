"""Bodies held along some axes only."""

from pathlib import Path

import numpy as np
import pytest
from blocks import make_block
from conftest import Figures
from scenes import GRAVITY, advance, silicone, simulate

from taichisoft import Control, Simulation, write_volume_mesh

SIZE = 20.0
STEP = 0.01
ALL = {"box": [[-SIZE, -SIZE, -SIZE], [SIZE, SIZE, SIZE]]}


def side(axis: int, directions: list[str]) -> dict[str, object]:
    """The lower side of the block along an axis, held along some."""
    high = [SIZE, SIZE, SIZE]
    high[axis] = -SIZE / 2
    return {"box": [[-SIZE, -SIZE, -SIZE], high], "directions": directions}


def block(folder: Path, anchors: list[dict[str, object]], **changes: float) -> dict[str, object]:
    path = folder / "block.msh"
    write_volume_mesh(make_block((2, 2, 2), (SIZE, SIZE, SIZE)), path)
    return silicone(str(path), anchors=anchors, rayleigh_stiffness=0.0, **changes)


def run(gravity: tuple[float, float, float], body: dict[str, object]) -> Simulation:
    return simulate(step=STEP, gravity=gravity, soft_bodies={"block": body})


def test_a_body_on_rails_falls_along_them(tmp_path: Path, figures: Figures) -> None:
    """Held along y and z it falls along x as implicit Euler says, by g h^2 n (n + 1) / 2, and moves along no other."""
    simulation = run((GRAVITY, GRAVITY, GRAVITY), block(tmp_path, [ALL | {"directions": ["y", "z"]}]))
    count = 10
    advance(simulation, count * STEP)
    moved = simulation.state.position - simulation.model.rest_position
    fall = GRAVITY * STEP**2 * count * (count + 1) / 2
    figures.at_most("error of the fall [mm]", np.abs(moved[:, 0] - fall).max(), 1e-8)
    figures.at_most("motion across [mm]", np.abs(moved[:, 1:]).max(), 1e-6)


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.45])
def test_a_block_on_rollers_is_stretched_evenly(tmp_path: Path, figures: Figures, poisson: float) -> None:
    """Three sides on rollers, a fourth pulled along x: strain e along x, and -nu e along y and z, to order e^2."""
    far = {"box": [[SIZE / 2, -SIZE, -SIZE], [SIZE, SIZE, SIZE]], "directions": ["x"]}
    rollers = [side(axis, [direction]) for axis, direction in enumerate("xyz")]
    simulation = run((0.0, 0.0, 0.0), block(tmp_path, [*rollers, far], poisson_ratio=poisson, rayleigh_mass=20.0))
    model = simulation.model
    target = model.rest_position[model.anchored_nodes].copy()
    strain = 0.001
    target[target[:, 0] > 0.5 * SIZE - 1e-9, 0] += strain * SIZE
    advance(simulation, 3.0, Control(anchor_positions={"block": target}))
    rest = model.rest_position
    expected = rest + (rest + SIZE / 2) * strain * [1.0, -poisson, -poisson]
    figures.at_most("error [mm]", np.abs(simulation.state.position - expected).max(), strain**2 * SIZE)


def test_the_base_carries_a_body_along_the_axes_that_hold_it(tmp_path: Path) -> None:
    simulation = run((0.0, 0.0, 0.0), block(tmp_path, [ALL | {"directions": ["z"]}]))
    advance(simulation, 0.1, Control(base_translation=np.array([5.0, 5.0, 5.0])))
    moved = simulation.state.position - simulation.model.rest_position
    np.testing.assert_allclose(moved, np.broadcast_to([0.0, 0.0, 5.0], moved.shape), atol=1e-6)


def test_a_later_anchor_takes_over_along_its_own_axes(tmp_path: Path) -> None:
    anchors = [ALL | {"stiffness": 2.0}, side(2, ["x", "y"]) | {"stiffness": 5.0}]
    (body,) = run((0.0, 0.0, 0.0), block(tmp_path, anchors)).model.soft_bodies
    low = body.rest_position[:, 2] < -SIZE / 2 + 1e-9
    np.testing.assert_array_equal(body.anchor_stiffness[low], np.tile([5.0, 5.0, 2.0], (low.sum(), 1)))
    np.testing.assert_array_equal(body.anchor_stiffness[~low], 2.0)
