"""What falls lies still where it lands, however fast it comes and however long the steps are."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
import trimesh
from scenes import CONTACT_DISTANCE, FLOOR, GRAVITY, silicone, simulate

from taichisoft import Simulation

STEPS_ABOVE = 1.7
"""How far above the floor bodies begin, in steps of their speed: the second step leads them into it."""
SURFACES = {
    "ball": trimesh.creation.icosphere(2, 15.0),
    "cylinder": trimesh.creation.cylinder(12.0, 30.0, sections=32),
    "torus": trimesh.creation.torus(14.0, 6.0, major_sections=24, minor_sections=12),
    "plate": trimesh.creation.box((60.0, 60.0, 2.0)),
}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, str]:
    """The files of the surfaces."""
    folder = tmp_path_factory.mktemp("surfaces")
    for name, surface in SURFACES.items():
        surface.export(folder / f"{name}.stl")
    return {name: str(folder / f"{name}.stl") for name in SURFACES}


@pytest.mark.parametrize("step", [0.02, 0.01, 0.005, 0.002])
@pytest.mark.parametrize("height", [30.0, 300.0, 2000.0])
@pytest.mark.parametrize("shape", ["box", "ball", "cylinder", "torus"])
def test_a_drop_ends_on_the_floor(files: Mapping[str, str], shape: str, height: float, step: float) -> None:
    """Without restitution it stays down: it never enters by the contact distance, and never rises again.

    It begins 1.7 steps above the floor with the speed sqrt(2 g h) of its fall. Rising: 0.01 mm, a hundredth of the
    contact distance; a box, whose faces meet flat, neither enters nor rises but for the solver's 1e-5 mm/s.
    """
    speed = np.sqrt(2 * GRAVITY * height)
    lowest = 10.0 if shape == "box" else -SURFACES[shape].bounds[0, 2]
    form: dict[str, Any] = {"box": [20, 20, 20]} if shape == "box" else {"surface": files[shape]}
    body = {**form, "mass": 0.02, "velocity": [0, 0, -speed]}
    simulation = simulate(
        step=step,
        gravity=(0.0, 0.0, -GRAVITY),
        rigid_bodies={"body": {**body, "position": [0, 0, lowest + CONTACT_DISTANCE + STEPS_ABOVE * step * speed]}},
        obstacles={"floor": FLOOR},
    )
    deepest, lowest_yet, risen = 0.0, np.inf, 0.0
    for _ in range(12):
        report = simulation.step()
        assert report.converged
        deepest = max(deepest, report.max_penetration)
        centre = simulation.state.rigid_position[0, 2]
        lowest_yet = min(lowest_yet, centre)
        risen = max(risen, centre - lowest_yet)
    assert lowest_yet == pytest.approx(lowest + CONTACT_DISTANCE, abs=0.1)
    assert deepest < (1e-6 if shape == "box" else CONTACT_DISTANCE)
    assert risen < (1e-6 if shape == "box" else 0.01)


@pytest.mark.parametrize("step", [0.01, 0.002])
@pytest.mark.parametrize("speed", [300.0, 1000.0])
@pytest.mark.parametrize("thrown", ["box", "ball", "soft", "turned"])
def test_nothing_passes_through_a_thin_plate(
    files: Mapping[str, str], soft_block: str, thrown: str, speed: float, step: float
) -> None:
    """10 mm bodies at up to their own size a step, onto a plate of 2 mm: they stop on the side that they came from."""
    above = (8.67 if thrown == "turned" else 5.0) + 1.0 + CONTACT_DISTANCE
    place, velocity = [0.0, 0.0, above + STEPS_ABOVE * step * speed], [0.0, 0.0, -speed]
    rigid: dict[str, dict[str, Any]] = {
        "box": {"box": [10, 10, 10]},
        "ball": {"surface": files["ball"], "scale": 1 / 3},
        "turned": {"box": [10, 10, 10], "rotation": [30, 40, 20]},
    }
    tables: dict[str, Any] = {"obstacles": {"plate": {"surface": files["plate"]}}}
    if thrown == "soft":
        tables["soft_bodies"] = {"body": silicone(soft_block, translation=place, velocity=velocity)}
    else:
        tables["rigid_bodies"] = {"body": {**rigid[thrown], "mass": 0.005, "position": place, "velocity": velocity}}
    simulation = simulate(step=step, **tables)
    for _ in range(20):
        report = simulation.step()
        assert report.converged
        assert report.max_penetration < CONTACT_DISTANCE
    assert _lowest(simulation) > 1.0
    if thrown == "box":
        assert _lowest(simulation) == pytest.approx(1.0 + CONTACT_DISTANCE, abs=1e-6)


def _lowest(simulation: Simulation) -> float:
    """The lowest point of the only moving body [mm]."""
    state = simulation.state
    if len(state.position):
        return float(state.position[:, 2].min())
    from taichisoft.base import matrices_from_quaternions

    turn = matrices_from_quaternions(state.rigid_rotation)[0]
    return float((simulation.model.rigid_bodies[0].vertices @ turn.T + state.rigid_position[0])[:, 2].min())


@pytest.fixture(scope="module")
def soft_block(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A block of 10 mm."""
    from blocks import make_block

    from taichisoft import write_volume_mesh

    path = tmp_path_factory.mktemp("soft") / "block.msh"
    write_volume_mesh(make_block((2, 2, 2), (10.0, 10.0, 10.0)), path)
    return str(path)
