"""The scene that taichisoft gives to the tests of plug-ins: small, closed, and good for a whole grasp."""

import numpy as np
import pytest

from taichisoft import Control, Controller, Model, Observation, Scene, Simulation, run
from taichisoft.running import plugin_registry
from taichisoft.running.plugins import Registry


class CloseAndLift(Controller):
    """Up to 9 kPa in 0.3 s, then upwards at 40 mm/s."""

    def __init__(self) -> None:
        self.seen: list[Observation] = []

    def reset(self, model: Model) -> None:
        self.seen.clear()

    def control(self, observation: Observation) -> Control:
        self.seen.append(observation)
        if observation.time < 0.3:
            return Control(pressure=dict.fromkeys(observation.pressures, 30.0 * observation.time))
        return Control(base_velocity=np.array([0.0, 0.0, 40.0]))


def test_pads_are_few_tetrahedra_around_closed_cavities(taichisoft_scene: Scene) -> None:
    simulation = Simulation(taichisoft_scene)
    assert simulation.model.node_count == 2 * 16
    assert simulation.observe().volumes == pytest.approx({"left.cavity": 14 * 12 * 12, "right.cavity": 14 * 12 * 12})


def test_scene_has_controller_table_as_scenes_of_users_have(taichisoft_scene: Scene) -> None:
    controller = Simulation(taichisoft_scene).model.scene.controller
    assert controller is not None and controller.name == "scripted"


def test_pads_close_on_cube_and_lift_it(taichisoft_scene: Scene) -> None:
    simulation, controller = Simulation(taichisoft_scene), CloseAndLift()
    run(simulation, controller, duration=0.6)
    pressing = [seen.normal_forces.get(("left", "cube"), 0.0) > 0.0 for seen in controller.seen]
    touched = controller.seen[pressing.index(True)]
    assert 6.0 < touched.pressures["left.cavity"] < 8.0
    assert touched.object_positions["cube"] == pytest.approx([0.0, 0.0, 5.2], abs=1e-3)
    seen = simulation.observe()
    assert seen.object_positions["cube"][2] - 5.2 == pytest.approx(40.0 * 0.3, abs=1.5)  # less what the pads lag behind
    weight = 0.001 * 9810.0
    assert seen.friction_forces["left", "cube"] + seen.friction_forces["right", "cube"] > weight
    assert ("cube", "floor") not in seen.normal_forces
    assert simulation.report is not None and simulation.report.converged


def test_registry_is_one_in_use_and_has_built_in_plugins(taichisoft_plugins: Registry) -> None:
    assert plugin_registry() is taichisoft_plugins
    assert {"controllers", "outputs"} <= set(taichisoft_plugins.origins)
