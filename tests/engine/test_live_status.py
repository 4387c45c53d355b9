"""The status of an interactive run: what it says, on a terminal and elsewhere."""

import io
from collections import deque
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from taichisoft import Control, KeyEvent, Scene, Session, Simulation
from taichisoft.running import run_command as module
from taichisoft.running.run_command import LiveStatus, live_status
from taichisoft.running.session import Pace
from taichisoft_controllers.keyboard_controller import KeyboardController


def session(**changes: Any) -> Any:
    """A run in which a cube was lifted by 3 cm against gravity along -x."""
    scene = SimpleNamespace(
        up=np.array([1.0, 0.0, 0.0]),
        main_object="cube",
        soft_bodies={"left": None, "right": None},
        rigid_bodies={"ball": None, "cube": None},
    )
    observation = SimpleNamespace(
        pressures={"left.air": 50.0, "right.air": 50.04},
        normal_forces={
            ("left", "cube"): 120.4,
            ("cube", "right"): 80.0,
            ("ball", "cube"): 5.0,
            ("cube", "floor"): 7.0,
            ("left", "right"): 9.0,
        },
    )
    pace = Pace(speed=1.0)
    pace.real_time_factor = 0.99
    parts = {
        "simulation": SimpleNamespace(
            model=SimpleNamespace(scene=scene),
            state=SimpleNamespace(time=2.5, rigid_position=np.array([[0.0, 0.0, 0.0], [-70.0, 71.0, 0.0]])),
            observe=lambda: SimpleNamespace(truth=observation),
            report=None,
        ),
        "first_state": SimpleNamespace(rigid_position=np.array([[0.0, 0.0, 0.0], [-100.0, 70.0, 0.0]])),
        "controller": SimpleNamespace(status="finger2 selected"),
        "pace": pace,
        "notice": "",
        "paused": False,
        "shows_help": False,
        "recent_keys": deque([KeyEvent("+"), KeyEvent("up", ctrl=True)]),
        "bindings": {"+ -": "change the pressure", "[r]": "start anew"},
    }
    return SimpleNamespace(**{**parts, **changes})


def picture(run: Any) -> str:
    """What is drawn on a terminal, without colours."""
    console = Console(file=io.StringIO(), width=100)
    with console.capture() as capture:
        console.print(LiveStatus(console, run).picture())
    return capture.get()


def test_status_shows_the_run() -> None:
    """Forces of soft bodies count as pressing, those of the floor and of other objects do not."""
    shown = picture(session())
    assert "2.50 s at 0.99 x real time" in shown
    assert "cannot keep up" not in shown and "paused" not in shown
    assert "pressure  50.0 kPa" in shown, "50.0 and 50.04 are the same to what is shown"
    assert "cube      lifted by 30.0 mm, pressed with 200 mN" in shown
    assert "keys      + Ctrl+up" in shown
    assert "finger2 selected; ? shows what the keys do, Esc ends the run" in shown
    assert "start anew" not in shown


def test_pressures_that_differ_are_named() -> None:
    run = session()
    run.simulation.observe().truth.pressures["right.air"] = 20.0
    assert "left.air 50.0 kPa, right.air 20.0 kPa" in picture(run)


@pytest.mark.parametrize(("factor", "slow"), [(0.5, True), (0.94, True), (0.96, False), (float("nan"), False)])
def test_status_shows_when_it_cannot_keep_up(factor: float, slow: bool) -> None:
    run = session()
    run.pace.real_time_factor = factor
    assert ("cannot keep up with 1 x" in picture(run)) == slow
    run.pace.speed = None
    assert "cannot keep up" not in picture(run)


def test_pause_and_keys_are_shown() -> None:
    assert "2.50 s, paused" in picture(session(paused=True))
    shown = picture(session(shows_help=True))
    assert "change the pressure" in shown
    assert "[r]" in shown, "not taken for markup"


def test_status_leaves_out_absent_parts() -> None:
    run = session(controller=SimpleNamespace(status=""), recent_keys=deque())
    run.simulation.observe = lambda: SimpleNamespace(truth=SimpleNamespace(pressures={}, normal_forces={}))
    shown = picture(run)
    assert "pressure  none" in shown and "lifted by 30.0 mm, pressed with 0 mN" in shown and "none yet" in shown
    run.simulation.model.scene.main_object = None
    assert "lifted" not in picture(run)


def test_status_is_of_the_present_state(taichisoft_scene: Scene) -> None:
    simulation = Simulation(taichisoft_scene)
    run = Session(simulation, KeyboardController())
    simulation.step(Control(pressure={"left.cavity": 2.0, "right.cavity": 2.0}))
    assert "pressure  2.0 kPa" in picture(run)
    simulation.restore(run.first_state)
    assert "pressure  0.0 kPa" in picture(run)


def test_status_replaces_itself_on_a_terminal() -> None:
    output = io.StringIO()
    run = session()
    console = Console(file=output, force_terminal=True, width=100, _environ={"TERM": "xterm"})
    with pytest.raises(ZeroDivisionError), live_status(console, run) as update:
        update(run.simulation.report)
        run.paused = True
        raise ZeroDivisionError
    shown = output.getvalue()
    assert "paused" in shown, "the last picture is the present one"
    assert shown.rfind("\x1b[?25h") > shown.rfind("\x1b[?25l") >= 0


@pytest.mark.parametrize("terminal", ["dumb", None])
def test_elsewhere_there_is_line_now_and_then(monkeypatch: pytest.MonkeyPatch, terminal: str | None) -> None:
    clock = iter([0.0, 4.9, 5.1, 5.1, 6.0, 11.0, 11.0, 12.0]).__next__
    monkeypatch.setattr(module.time, "monotonic", clock)
    output = io.StringIO()
    console = Console(
        file=output, force_terminal=terminal is not None, color_system=None, width=40, _environ={"TERM": terminal or ""}
    )
    run = session()
    with live_status(console, run) as update:
        for time in (2.4, 2.6, 3.5, 8.5):
            run.simulation.state.time = time
            update(run.simulation.report)
    lines = output.getvalue().splitlines()
    assert [line.split(" ")[0] for line in lines] == ["2.60", "8.50", "8.50"], "two when it was time, one at the end"
    assert lines[0].endswith(" s at 0.99 x real time; 50.0 kPa; cube lifted by 30.0 mm, pressed with 200 mN")


def test_help_is_printed_once_for_each_request() -> None:
    output = io.StringIO()
    run = session()
    with live_status(Console(file=output, width=100), run) as update:
        for shows_help in (False, True, True, False, True):
            run.shows_help = shows_help
            update(run.simulation.report)
    assert output.getvalue().count("change the pressure") == 2


class ClosedTerminal(io.StringIO):
    """Where nobody is any more."""

    def write(self, _: str) -> int:
        raise OSError(5, "Input/output error")


@pytest.mark.parametrize("is_terminal", [True, False])
@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_terminal_that_is_gone_does_not_end_run(is_terminal: bool) -> None:
    run = session()
    console = Console(file=ClosedTerminal(), force_terminal=is_terminal, _environ={"TERM": "xterm"})
    with live_status(console, run) as update:
        update(run.simulation.report)
