"""Settings of a controller are tuned during its run."""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taichisoft import KeyEvent, Output, Session, Simulation, Slider, load_plugin, load_scene, make_controller
from taichisoft.errors import PluginError
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.running.loop import run_session
from taichisoft.running.run_command import _controller_with

CODE = """
from taichisoft import Control, Controller, Slider, hookimpl


class Ramp(Controller):
    interactive = True
    tunable = {"rate": Slider(20.0, 0.0, 100.0, 1.0, "kPa/s")}

    def __init__(self, rate: float = 20.0):
        if rate == 99.0:
            raise ValueError("too fast")
        self.rate = rate

    def reset(self, model):
        self.asked = 0.0

    def control(self, observation):
        self.asked += self.rate * observation.control_period
        return Control(pressure={"left.cavity": self.asked}, signals={"asked": self.asked})

    def save(self):
        return {"asked": self.asked}

    def restore(self, saved):
        self.asked = saved["asked"]


@hookimpl
def taichisoft_controllers():
    return {"ramp": Ramp}
"""


class Steered(Output):
    """Does something after certain steps, and notes what was asked for and what the controller remembered."""

    def __init__(self, actions: dict[int, Callable[[], None]]):
        self.actions, self.asked, self.memories = actions, [], []  # type: Any, list[float], list[str]

    def record(self, state: Any, report: Any) -> None:
        self.asked.append(report.signals["asked"])
        self.memories.append(self.save_controller())
        self.actions.pop(len(self.asked), lambda: None)()


@pytest.fixture
def running(tmp_path: Path, taichisoft_plugins: Any) -> Callable[..., Session]:
    """Makes a session of the controller in a file."""
    path = tmp_path / "ramp.py"
    path.write_text(CODE)
    load_plugin(path)

    def made(saved: Any = None, steps: int = 8) -> Session:
        scene = load_scene(TINY_GRIPPER, [], "ramp")
        make_again = partial(_controller_with, scene)
        controller = make_controller(scene)
        return Session(Simulation(scene), controller, duration=0.01 * steps, saved=saved, make_controller=make_again)

    return made


def run(running: Session, actions: dict[int, Callable[[], None]]) -> Steered:
    output = Steered(actions)
    running.outputs = [output]
    run_session(running)
    return output


def test_tuned_setting_counts_from_the_next_step_and_on_resume(running: Callable[..., Session]) -> None:
    first = running()
    assert first.sliders["rate"].value == 20.0 and first.sliders["rate"].group == "settings of ramp"
    output = run(first, {4: lambda: first.keys.put(KeyEvent("rate", value=50.0))})
    assert output.asked == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.3, 1.8, 2.3, 2.8])
    assert first.sliders["rate"].value == 50.0

    # A run that goes on from there goes on with the setting; beyond the end of the slider it is the end.
    again = running(saved=json.loads(output.memories[5]), steps=4)
    rest = run(again, {1: lambda: again.keys.put(KeyEvent("rate", value=1e6))})
    assert rest.asked == pytest.approx([2.3, 3.3, 4.3, 5.3])
    assert again.sliders["rate"].value == 100.0


@pytest.mark.parametrize("wrong", [{"lowest": 2.0}, {"step": 0.0}, {"highest": np.nan}])
def test_slider_without_range_or_step_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(PluginError, match=r"Slider\(.*\): lowest must not be above highest"):
        Slider(**{"value": 0.5, "lowest": 0.0, "highest": 1.0, "step": 0.1, "unit": "mm", **wrong})  # type: ignore[arg-type]


def test_setting_that_fails_leaves_the_old_controller_at_work(running: Callable[..., Session]) -> None:
    steered = running()
    with pytest.warns(UserWarning, match=r"at 0\.04 s: the old controller goes on: .*cannot be made.*too fast"):
        output = run(steered, {4: lambda: steered.keys.put(KeyEvent("rate", value=99.0))})
    assert output.asked == pytest.approx(0.2 * np.arange(1, 9))
    assert "goes on" in steered.notice and steered.sliders["rate"].value == 20.0
