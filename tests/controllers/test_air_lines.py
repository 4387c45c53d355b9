"""Controllers and the valves of air lines: keys, scripts and environments drive what a cavity has."""

from pathlib import Path

import pytest

from taichisoft import KeyEvent, Simulation, load_scene
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
