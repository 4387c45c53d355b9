"""Controllers and the valves of air lines: keys, scripts and environments drive what a cavity has."""

from pathlib import Path

import numpy as np
import pytest

from taichisoft import KeyEvent, Simulation, load_scene
from taichisoft.errors import SceneError
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft_controllers.keyboard_controller import KeyboardController
from taichisoft_controllers.scripted_controller import scripted_controller
from taichisoft_gym.actuation import Actuation

LINE = "{supply = 60.0, conductance = 0.02}"
REGULATOR = "{conductance = 0.02}"


def simulation(left: str, right: str = 'air = "regulated"') -> Simulation:
    cavities = [
        f'soft_bodies.{finger}.cavities.cavity={{group = "cavity", {air}}}'
        for finger, air in (("left", left), ("right", right))
    ]
    return Simulation(load_scene(TINY_GRIPPER, cavities))


def test_keys_change_what_a_cavity_has() -> None:
    """+ opens the valve of the line by its step and raises the pressure of the other; sealed air has no slider."""
    model = simulation(f'air = "line", line = {LINE}').model
    controller = KeyboardController(valve_step=0.25)
    controller.reset(model)
    assert {name: (one.lowest, one.highest) for name, one in controller.sliders.items()} == {
        "left.cavity": (-1.0, 1.0),
        "right.cavity": (0.0, 30.0),
    }
    for _ in range(5):
        controller.key(KeyEvent("-"))
    controller.key(KeyEvent("+"))
    control = controller.control(Simulation(model).observe())
    assert control.valve == {"left.cavity": -0.75} and control.pressure == {"right.cavity": 1.0}
    assert "open the valve to the source by 0.25" in controller.bindings["+"]
    controller.reset(simulation('air = "sealed"').model)
    assert list(controller.sliders) == ["right.cavity"]


def test_a_script_steers_a_valve_and_shuts_it(tmp_path: Path) -> None:
    """Filled through the valve until 8 kPa are there, then shut: the pressure stays."""
    script = tmp_path / "fill.toml"
    script.write_text(
        "[[steps]]\nvalve = { left = 0.5 }\nvalve_rate = 20.0\nuntil = 'pressure[\"left\"] > 8'\ntimeout = 1.0\n"
        "[[steps]]\nvalve = { left = 0.0 }\nduration = 0.01\n"
    )
    made, controller = simulation(f'air = "line", line = {LINE}'), scripted_controller(str(script))
    controller.reset(made.model)
    for _ in range(60):
        report = made.step(controller.control(made.observe()))
    seen = report.observation
    assert seen.valve_openings["left.cavity"] == 0.0 == seen.air_flows["left.cavity"]
    assert 5.0 < seen.pressures["left.cavity"] < 12.0 and seen.pressures["right.cavity"] == 0.0


def test_a_script_of_pressures_drives_a_regulator(tmp_path: Path) -> None:
    script = tmp_path / "inflate.toml"
    script.write_text("keyframes = [{ time = 0.0, pressure = 0.0 }, { time = 0.1, pressure = 10.0 }]\n")
    made, controller = simulation(f'air = "line", line = {REGULATOR}'), scripted_controller(str(script))
    controller.reset(made.model)
    for _ in range(12):
        made.step(controller.control(made.observe()))
    assert 1.0 < made.observe().pressures["left.cavity"] < made.observe().pressures["right.cavity"]


def test_actions_of_environments_are_what_can_be_driven() -> None:
    scene = simulation(f'air = "line", line = {LINE}').model.scene
    channels = Actuation(scene, (0.0, 20.0), None).channels
    assert [(one.name, one.low, one.high) for one in channels] == [
        ("valve left.cavity", -1.0, 1.0),
        ("pressure right.cavity", 0.0, 20.0),
    ]
    channels = Actuation(simulation('air = "sealed"').model.scene, (0.0, 20.0), None).channels
    assert [one.name for one in channels] == ["pressure right.cavity"]


@pytest.mark.parametrize("made", ["pressure", "valve"])
def test_a_script_cannot_ask_what_a_cavity_has_not(tmp_path: Path, made: str) -> None:
    """`pressure` of a line with a constant supply, and `valve` of regulated air, are names that there are not."""
    script = tmp_path / "wrong.toml"
    finger = {"pressure": "left", "valve": "right"}[made]
    script.write_text(f"[[steps]]\n{made} = {{ {finger} = 1.0 }}\nduration = 0.1\n")
    controller = scripted_controller(str(script))
    with pytest.raises(Exception, match=f"steps.0.{made}: .*'{finger}'"):
        controller.reset(simulation(f'air = "line", line = {LINE}').model)


NETWORK = (
    'soft_bodies.left.cavities.cavity={group = "cavity", air = "network"}',
    'soft_bodies.right.cavities.cavity={group = "cavity"}',
    "air.sources.pump={}",
    "air.tanks.bottle={volume = 100.0}",
    'air.valves.inflate={inlet = "pump", outlet = "bottle", conductance = 0.01}',
    'air.tubes.tube={inlet = "bottle", outlet = "left.cavity", length = 100.0, diameter = 2.0}',
)


def test_keys_and_actions_drive_a_network() -> None:
    """A slider, and a number of an action, for each valve and regulator, which the observation shows as well."""
    made = Simulation(load_scene(TINY_GRIPPER, NETWORK))
    controller = KeyboardController()
    controller.reset(made.model)
    assert list(controller.sliders) == ["right.cavity", "inflate", "pump"]
    assert (controller.sliders["inflate"].lowest, controller.sliders["inflate"].highest) == (0.0, 1.0)
    controller.key(KeyEvent("inflate", value=0.5))
    controller.key(KeyEvent("pump", value=10.0))
    control = controller.control(made.observe())
    assert control.valve == {"inflate": 0.5} and control.pressure == {"right.cavity": 0.0, "pump": 10.0}
    actions = Actuation(made.model.scene, (0.0, 20.0), None)
    assert [(one.name, one.low, one.high) for one in actions.channels] == [
        ("pressure right.cavity", 0.0, 20.0),
        ("valve inflate", 0.0, 1.0),
        ("pressure pump", 0.0, 20.0),
    ]
    seen = made.step(actions.control(np.array([-1.0, 0.0, 1.0]), made, 0.01)).observation
    assert actions.read(seen) == [0.0, 0.5, 0.01 * made.model.scene.limits.pressure_rate]


def test_keys_leave_valves_at_their_opening_until_one_is_moved() -> None:
    """A slider begins where the scene opens the valve, and a regulator's at its lowest pressure: nothing is shut."""
    given = ("air.valves.inflate.opening=0.7", "air.sources.pump.lowest_pressure=4.0")
    made = Simulation(load_scene(TINY_GRIPPER, (*NETWORK, *given)))
    controller = KeyboardController()
    controller.reset(made.model)
    seen = made.step(controller.control(made.observe())).observation
    assert seen.network_openings == {"inflate": 0.7} and seen.network_pressures["pump"] == 4.0


def test_a_script_steers_a_network(tmp_path: Path) -> None:
    """Regulator and valves of the table `air` are driven by their names, beside a cavity with its own regulator."""
    script = tmp_path / "network.toml"
    script.write_text(
        "[[steps]]\npressure = { pump = 20.0, right = 5.0 }\nvalve = { inflate = 1.0 }\nduration = 0.1\n"
        "[[steps]]\nuntil = 'network_pressure[\"bottle\"] > 10'\ntimeout = 1.0\n"
        "[[steps]]\nvalve = { inflate = 0.0 }\nduration = 0.02\n"
    )
    made, controller = Simulation(load_scene(TINY_GRIPPER, NETWORK)), scripted_controller(str(script))
    controller.reset(made.model)
    seen = made.observe()
    assert seen.network_openings == {"inflate": 0.0}
    most = 0.0
    for _ in range(60):
        seen = made.step(controller.control(made.observe())).observation
        most = max(most, seen.network_openings["inflate"])
    assert most == 1.0 and seen.network_openings["inflate"] == 0.0 == seen.network_flows["inflate"]
    assert seen.network_pressures["pump"] == 20.0 and seen.pressures["right.cavity"] == 5.0
    assert seen.pressures["left.cavity"] > 8.0
    script.write_text("[[steps]]\nvalve = { inflated = 1.0 }\nduration = 0.1\n")
    with pytest.raises(SceneError, match=r"steps.0.valve: .*'inflated'.*inflate"):
        scripted_controller(str(script)).reset(made.model)
