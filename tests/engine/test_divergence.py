"""A simulation that leaves all reason stops with a name, a step and a cause, and keeps its last good state."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from taichisoft import Control, Scene, Simulation
from taichisoft.errors import SimulationDiverged
from taichisoft.scene import scene_from_dict


@pytest.fixture
def simulation(block: Callable[..., str]) -> Simulation:
    """A soft block with a cavity, another without, and a rigid box, far from each other."""
    body = {"mass": 0.01, "young_modulus": 100, "poisson_ratio": 0.3}
    hollow = {
        **body,
        "mesh": block((3, 3, 3), (20.0, 20.0, 20.0), hollow=True),
        "cavities": {"air": {"group": "cavity"}},
    }
    bodies = {"solid": {**body, "mesh": block((1, 1, 1), (10.0, 10.0, 10.0)), "translation": [0, 0, 100]}}
    scene = {
        "gravity": [0, 0, 0],
        "soft_bodies": {**bodies, "hollow": hollow},
        "rigid_bodies": {"box": {"box": [10, 10, 10], "mass": 1, "position": [0, 0, 200]}},
    }
    simulation = Simulation(scene_from_dict(scene))
    simulation.step()
    return simulation


def expect(simulation: Simulation, body: str, cause: str, control: Control | None = None) -> None:
    """The next step fails for that body and leaves the state as it is."""
    before = simulation.state.copy()
    with pytest.raises(SimulationDiverged) as failed:
        simulation.step(control)
    error = failed.value
    assert (error.body, error.step) == (body, simulation.state.step)
    assert cause in error.cause
    assert str(error).startswith(f"step {error.step}: body '{body}' ")
    assert error.advice in str(error)
    assert simulation.state is not None
    np.testing.assert_array_equal(simulation.state.position, before.position)
    assert simulation.state.step == before.step


def test_an_absurd_pressure_explodes(simulation: Simulation) -> None:
    expect(simulation, "hollow", "exploded", Control(pressure={"hollow.air": 1e9}))
    simulation.step(Control(pressure={"hollow.air": 1.0}))  # and it can go on from there


def test_thrown_body_explodes_and_flying_one_does_not(simulation: Simulation) -> None:
    """A fast body in free flight moves by many times its size in every step; one that does so at once was thrown."""
    simulation.state = replace(simulation.state, rigid_velocity=np.array([[0.0, 1e6, 0.0]]))
    simulation.step()
    box = {"box": [10, 10, 10], "mass": 1}
    thrown = Simulation(scene_from_dict({"gravity": [0, 0, 1e8], "rigid_bodies": {"box": box}}))
    expect(thrown, "box", "exploded: it would move 1e+04 mm in one step, over 10 times its size")


def test_nan_in_a_body_is_named(simulation: Simulation) -> None:
    good, position = simulation.state, simulation.state.position.copy()
    position[simulation.model.soft_bodies[1].nodes.start + 3, 1] = np.nan
    velocity = np.array([[0.0, np.nan, 0.0]])
    for body, bad in (("hollow", {"position": position}), ("box", {"rigid_velocity": velocity})):
        simulation.state = replace(good, **bad)
        with pytest.raises(SimulationDiverged, match=r"not finite|not positive definite") as failed:
            simulation.step()
        assert failed.value.body == body


def test_a_body_turned_inside_out_is_named(simulation: Simulation) -> None:
    """Thrown through itself in one step, to its mirror image in x: all six elements have a negative volume.

    The check is of the new state, so that the last good one is not inverted.
    """
    body = simulation.model.soft_bodies[0]
    velocity = simulation.state.velocity.copy()
    away = simulation.state.position[body.nodes, 0] - simulation.state.position[body.nodes, 0].mean()
    velocity[body.nodes, 0] = -100 * away / simulation.model.scene.time.step
    simulation.state = replace(simulation.state, velocity=velocity)
    expect(simulation, "solid", "elements turned inside out")


def test_a_cavity_whose_walls_go_through_each_other_is_named(taichisoft_scene: Scene) -> None:
    """A volume of less than nothing is no volume, whatever the elements around it look like."""
    changes = {"limits": {}, "rigid_bodies": {}, "obstacles": {}}
    simulation = Simulation(scene_from_dict(taichisoft_scene.model_dump(exclude_none=True) | changes))
    rest = simulation.state.actuator_value
    suction = Control(pressure=dict.fromkeys(simulation.model.cavities.names, -100.0))
    with pytest.raises(
        SimulationDiverged, match=r"collapsed cavity: the walls of '(left|right)\.cavity' went through"
    ) as failed:
        for _ in range(50):
            simulation.step(suction)
    assert failed.value.body in ("left", "right")
    assert (simulation.state.actuator_value > 0.0).all() and (simulation.state.actuator_value < rest).all()


def test_element_is_inverted_at_any_integration_point(block: Callable[..., str]) -> None:
    """Of a quadratic element all corners rest, and the middle of a side is beyond the opposite one; in a step too short
    for anything to move, its points tell that it is inside out, where its corners span the volume that they had."""
    body = {"mass": 0.01, "young_modulus": 100, "poisson_ratio": 0.3, "element": "quadratic", "law": "neo-hookean"}
    body |= {"mesh": block((1, 1, 1), (10.0, 10.0, 10.0))}
    scene = {"gravity": [0, 0, 0], "time": {"step": 1e-6}, "soft_bodies": {"body": body}}
    simulation = Simulation(scene_from_dict(scene))
    assert simulation.step().inverted_elements == 0
    position, elements = simulation.state.position.copy(), simulation.model.soft_bodies[0].elements
    middle, opposite = elements[0, 4], elements[0, [2, 3]]
    position[middle] += 1.2 * (position[opposite].mean(axis=0) - position[middle])
    simulation.restore(simulation.state.changed(position=position))
    assert simulation.step().inverted_elements > 0
    corners = simulation.state.position[elements[:, :4]]
    assert np.linalg.det(corners[:, 1:] - corners[:, :1]).min() > 0.0


@pytest.mark.parametrize("law", ["hooke", "neo-hookean"])
def test_laws_of_rubber_go_on_where_all_elements_are_inside_out(block: Callable[..., str], law: str) -> None:
    """Mirrored: under Hooke's law the run ends, with an advice; under one of rubber the count is in the report."""
    body = {"mass": 0.01, "young_modulus": 100, "poisson_ratio": 0.3, "element": "smoothed", "law": law}
    body |= {"mesh": block((1, 1, 1), (10.0, 10.0, 10.0)), "rayleigh_stiffness": 10.0}
    simulation = Simulation(scene_from_dict({"gravity": [0, 0, 0], "soft_bodies": {"solid": body}}))
    mirrored = simulation.model.rest_position * [-1.0, 1.0, 1.0]
    simulation.restore(simulation.state.changed(position=mirrored))
    if law == "hooke":
        expect(simulation, "solid", "6 of 6 elements turned inside out")
    else:
        assert simulation.step().inverted_elements == 6


@pytest.mark.parametrize("newton", [1, 20])
def test_what_is_advised_for_rubber_helps(block: Callable[..., str], newton: int) -> None:
    """A nearly incompressible beam under 4 g at once turns so far in 10 ms that one linearisation explodes."""
    body = {
        "mesh": block((7, 2, 2), (100.0, 30.0, 30.0)),
        "density": 1.07e-6,
        "young_modulus": 255.0,
        "poisson_ratio": 0.499,
        "element": "quadratic",
        "law": "neo-hookean",
        "anchors": [{"box": [[-50, -15, -15], [-50, 15, 15]]}],
    }
    time = {"step": 0.01, "newton": newton}
    beam = Simulation(scene_from_dict({"gravity": [0, 0, -39240], "time": time, "soft_bodies": {"beam": body}}))
    if newton == 1:
        with pytest.raises(SimulationDiverged, match=r"a smaller time\.step, time\.newton = 20, a lower pressure"):
            for _ in range(30):
                beam.step()
    else:
        for _ in range(30):
            assert beam.step().converged
        assert 10.0 < np.abs(beam.state.position - beam.model.rest_position).max() < 40.0
