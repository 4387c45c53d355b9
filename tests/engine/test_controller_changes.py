"""A controller takes other settings, and a newer version of its file, while its run goes on."""

import json
import os
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taichisoft import KeyEvent, Output, Session, Simulation, Slider, load_plugin, load_scene, make_controller
from taichisoft.errors import PluginError
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.running import run_session
from taichisoft.running.run_command import _controller_with

CODE = """
from taichisoft import Control, Controller, Slider, hookimpl


class Ramp(Controller):
    interactive = True
    tunable = {{"rate": Slider(20.0, 0.0, 100.0, 1.0, "kPa/s")}}

    def __init__(self, rate: float = 20.0):
        self.rate = rate

    def reset(self, model):
        self.asked = 0.0

    def control(self, observation):
        self.asked += {sign}self.rate * observation.control_period
        return Control(pressure={{"left.cavity": self.asked}}, signals={{"asked": self.asked}})

{memory}

@hookimpl
def taichisoft_controllers():
    return {{"ramp": Ramp}}
"""
MEMORY = """
    def save(self):
        return {"asked": self.asked}

    def restore(self, saved):
        self.asked = saved["asked"]
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
def write(tmp_path: Path, taichisoft_plugins: Any) -> Iterator[Callable[..., Path]]:
    """Writes the file of the plug-in, each time with a later date."""
    versions = iter(range(1, 100))

    def written(sign: str = "", memory: str = MEMORY, text: str | None = None) -> Path:
        path = tmp_path / "ramp.py"
        path.write_text(CODE.format(sign=sign, memory=memory) if text is None else text)
        os.utime(path, (1e9 + next(versions),) * 2)
        return path

    yield written


def session(path: Path, monkeypatch: pytest.MonkeyPatch, saved: Any = None, steps: int = 8) -> Session:
    monkeypatch.setattr("taichisoft.running.loop.SECONDS_BETWEEN_LOOKS", 0.0)
    load_plugin(path)
    scene = load_scene(TINY_GRIPPER, [], "ramp")
    made = make_controller(scene)
    simulation = Simulation(scene)
    return Session(
        simulation, made, duration=0.01 * steps, saved=saved, make_controller=partial(_controller_with, scene)
    )


def run(running: Session, actions: dict[int, Callable[[], None]]) -> Steered:
    output = Steered(actions)
    running.outputs = [output]
    run_session(running)
    return output


def test_a_tuned_setting_counts_from_the_next_step_and_what_was_done_stays(
    write: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    running = session(write(), monkeypatch)
    assert running.sliders["rate"].value == 20.0 and running.sliders["rate"].group == "settings of ramp"
    output = run(running, {4: lambda: running.keys.put(KeyEvent("rate", value=50.0))})
    assert output.asked == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.3, 1.8, 2.3, 2.8])
    assert running.sliders["rate"].value == 50.0

    # A run that goes on from there goes on with the setting; beyond the end of the slider it is the end.
    memory = json.loads(output.memories[5])
    again = session(write(), monkeypatch, saved=memory, steps=4)
    rest = run(again, {1: lambda: again.keys.put(KeyEvent("rate", value=1e6))})
    assert rest.asked == pytest.approx([2.3, 3.3, 4.3, 5.3])
    assert again.sliders["rate"].value == 100.0


@pytest.mark.parametrize("wrong", [{"lowest": 2.0}, {"step": 0.0}, {"highest": np.nan}])
def test_a_slider_that_nobody_can_move_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(PluginError, match=r"Slider\(.*\): lowest must not be above highest"):
        Slider(**{"value": 0.5, "lowest": 0.0, "highest": 1.0, "step": 0.1, "unit": "mm", **wrong})  # type: ignore[arg-type]


def test_a_saved_file_is_loaded_and_its_controller_goes_on(
    write: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    running = session(write(), monkeypatch)
    with pytest.warns(UserWarning, match="plug-in 'ramp' was loaded anew, and its controller goes on"):
        output = run(running, {4: lambda: write("-") and None})
    assert output.asked == pytest.approx([0.2, 0.4, 0.6, 0.8, 0.6, 0.4, 0.2, 0.0], abs=1e-12)
    assert "goes on" in running.notice


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("def broken(:", "the old version of plug-in 'ramp' goes on: .*SyntaxError"),
        ("x = 1", "the old version of plug-in 'ramp' goes on: .*implements no hook"),
        (
            CODE.format(sign="", memory=MEMORY.replace('saved["asked"]', 'saved["other"]')),
            r"at 0\.04 s: the old controller goes on: .*Ramp failed in restore\(\): KeyError: 'other' \(ramp\.py, line",
        ),
        (
            CODE.format(sign="other.", memory=MEMORY),
            r"failed in control\(\): NameError.*other.* \(ramp\.py, line 16\)",
        ),
        (CODE.format(sign="", memory=MEMORY).replace('"ramp"', '"lamp"'), "no controller is called 'ramp'"),
    ],
)
def test_a_file_with_an_error_leaves_the_old_controller_at_work(
    write: Callable[..., Path], monkeypatch: pytest.MonkeyPatch, text: str, problem: str
) -> None:
    running = session(write(), monkeypatch)
    with pytest.warns(UserWarning, match=problem):
        output = run(running, {4: lambda: write(text=text) and None})
    assert output.asked == pytest.approx(0.2 * np.arange(1, 9))


def test_a_controller_that_does_not_save_waits_for_the_next_start(
    write: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    running = session(write(memory=""), monkeypatch)
    actions = {3: lambda: write("-", memory="") and None, 5: lambda: running.keys.put(KeyEvent("r"))}
    with pytest.warns(UserWarning, match="waits for r"):
        output = run(running, actions)  # type: ignore[arg-type]
    assert output.asked[:7] == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0, -0.2, -0.4])


def test_a_run_that_nobody_steers_keeps_the_file_it_began_with(
    write: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    running = session(write(), monkeypatch)
    running.controller.interactive = False
    output = run(running, {4: lambda: write("-") and None})
    assert output.asked == pytest.approx(0.2 * np.arange(1, 9))
