"""A soft body that touches itself: nothing passes through, what pushes pushes back, and friction holds."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blocks import make_block
from conftest import Figures
from scenes import silicone, simulate, soft_momentum

from taichisoft import Simulation, VolumeMesh, write_volume_mesh

GAP = {"contact_distance": 0.5, "alarm_distance": 4.0}
PULL = 29430.0
"""Three times gravity, which bends the upper arm of the clip onto the lower one [mm/s^2]."""
CELLS, SIZE = (10, 2, 4), (40.0, 8.0, 12.0)
LAYER = SIZE[2] / CELLS[2]


def make_clip(path: Path, finer: int = 1) -> str:
    """Two arms of 36 x 8 x 3 mm above each other, 6 mm apart, joined at one end: a C, open at positive x."""
    whole = make_block((finer * CELLS[0], CELLS[1], finer * CELLS[2]), SIZE)
    middle = whole.nodes[whole.elements].mean(axis=1)
    kept = whole.elements[(np.abs(middle[:, 2]) > LAYER) | (middle[:, 0] < SIZE[0] / CELLS[0] - SIZE[0] / 2)]
    used, elements = np.unique(kept, return_inverse=True)
    write_volume_mesh(VolumeMesh("clip", whole.nodes[used], elements.reshape(-1, 4)).check(), path)
    return str(path)


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Its arms are one cell thick."""
    return make_clip(tmp_path_factory.mktemp("clip") / "clip.msh")


def closing(mesh: str, self_contact: bool, friction: float = 0.6, sideways: float = 0.0, **changes: Any) -> Simulation:
    """The clip with its lower arm held from below; its weight, threefold, bends the upper arm onto it."""
    table = silicone(
        mesh,
        young_modulus=15.0,
        corotation="polar",
        rayleigh_stiffness=0.02,
        anchors=[{"box": [[-20.0, -4.0, -6.0], [20.0, 4.0, -5.9]]}],
        **({"self_contact": True} if self_contact else {}),
        **changes,
    )
    contact = {**GAP, "friction": friction}
    return simulate(gravity=(0.0, sideways, -PULL), step=0.004, soft_bodies={"clip": table}, contact=contact)


def arms(simulation: Simulation) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of the upper side of the lower arm, and of the lower side of the upper one, beyond the bend."""
    rest = simulation.model.rest_position
    beyond = rest[:, 0] > -10.0
    lower, upper = (beyond & np.isclose(rest[:, 2], side * LAYER) for side in (-1, 1))
    return np.flatnonzero(lower), np.flatnonzero(upper)


def least_gap(simulation: Simulation) -> float:
    """How far the upper arm is above the lower one where it is nearest [mm]."""
    lower, upper = arms(simulation)
    height = simulation.state.position[:, 2]
    return float(height[upper].min() - height[lower].max())


def test_without_self_contact_an_arm_passes_through_the_other(clip: str) -> None:
    simulation = closing(clip, self_contact=False)
    for _ in range(75):
        assert simulation.step().contact_count == 0
    assert least_gap(simulation) < -2.0


def test_arms_that_close_on_each_other_stay_apart(clip: str, figures: Figures) -> None:
    """They come to lie on each other at the contact distance; to a tenth of it between the highest vertex of the lower
    arm and the lowest of the upper one, which are not above each other. The bend carries a part of the weight.
    """
    simulation = closing(clip, self_contact=True)
    deepest = 0.0
    for _ in range(75):
        report = simulation.step()
        assert report.converged
        deepest = max(deepest, report.max_penetration)
    figures.close("distance of the arms [mm]", least_gap(simulation), GAP["contact_distance"], 0.05)
    figures.at_most("reach into the contact distance [mm]", deepest, 0.1 * GAP["contact_distance"])
    weight = 1e-6 * 36 * 8 * 3 * PULL
    assert 0.1 * weight < report.observation.normal_forces["clip", "clip"] < weight


def test_what_a_body_pushes_on_itself_does_not_move_it(clip: str, figures: Figures) -> None:
    """A free clip whose arms fly at each other: the momentum of the whole stays, to round-off."""
    table = silicone(clip, young_modulus=50.0, corotation="polar", self_contact=True)
    simulation = simulate(soft_bodies={"clip": table}, contact=GAP, step=0.005)
    velocity = simulation.state.velocity.copy()
    velocity[simulation.model.rest_position[:, 2] > 0.0, 2] = -800.0
    velocity[:, 1] = 50.0
    simulation.restore(simulation.state.changed(velocity=velocity))
    before, touched = soft_momentum(simulation), 0.0
    for _ in range(30):
        report = simulation.step()
        touched = max(touched, report.observation.normal_forces.get(("clip", "clip"), 0.0))
    assert touched > 0.0
    drift = np.abs(soft_momentum(simulation) - before).max() / np.linalg.norm(before)
    figures.at_most("change of momentum, of the whole", float(drift), 1e-11)


def test_friction_holds_an_arm_on_the_other(clip: str, figures: Figures) -> None:
    """Pressed down and pulled aside by a fifth of that: with friction 0.6 the tip stays over the other as it landed,
    without friction it slides on until the bend holds it."""
    aside = {}
    for friction in (0.0, 0.6):
        simulation = closing(clip, True, friction, sideways=0.2 * PULL)
        for _ in range(100):
            simulation.step()
        lower, upper = arms(simulation)
        position = simulation.state.position
        tip = upper[simulation.model.rest_position[upper, 0] > 19.0]
        moved = (position - simulation.model.rest_position)[:, 1]
        aside[friction] = float(moved[tip].mean() - moved[lower].mean())
        forces = simulation.observe().friction_forces[("clip", "clip")]
        assert (forces > 1.0) is (friction > 0.0)
    figures.at_most("slide with friction over that without", aside[0.6] / aside[0.0], 0.8)


@pytest.mark.parametrize("shape", ["clip", "block", "tutorial-coarse"])
def test_nothing_touches_itself_at_rest(tmp_path: Path, shape: str) -> None:
    """Neighbours along the skin and through walls are no contacts, in any position of the body.

    In the corners inside the clip vertices are 1.5 mm from the next side, and its arms are 3 mm thick: the contact
    distance of 2 mm would push the ones apart, and takes the arms, which are 6 mm apart, for no neighbours.
    """
    mesh = shape
    if shape == "clip":
        mesh = make_clip(tmp_path / "clip.msh", finer=2)
    if shape == "block":
        mesh = str(tmp_path / "block.msh")
        write_volume_mesh(make_block((3, 3, 3), (12.0, 12.0, 12.0)), Path(mesh))
    table = silicone(mesh, self_contact=True, rotation=[10, 20, 30])
    contact = {"contact_distance": 2.0, "alarm_distance": 7.0}
    simulation = simulate(soft_bodies={"body": table}, contact=contact)
    report = simulation.step()
    assert report.max_penetration == 0.0
    assert np.abs(report.contact_forces).sum() == 0.0
    assert (report.contact_count > 0) is (shape != "block")


def test_a_body_that_touches_nothing_moves_as_without_self_contact(clip: str) -> None:
    """Equal to the bit as long as nothing is within reach."""
    states = []
    for itself in (False, True):
        simulation = closing(clip, self_contact=itself)
        for _ in range(3):
            simulation.step()
        states.append(simulation.state)
    assert (states[0].position == states[1].position).all()
