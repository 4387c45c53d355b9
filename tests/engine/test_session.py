"""Keys, pauses, restarts, replays, periods and time limits of a run."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taichisoft import (
    Control,
    Controller,
    KeyEvent,
    Observation,
    Output,
    Session,
    Simulation,
    State,
    StepReport,
    hookimpl,
    register_plugin,
    unregister_plugin,
)
from taichisoft.errors import ControllerFailed, PluginError, SceneError
from taichisoft.running.loop import run_session
from taichisoft.running.session import KeyReplay
from taichisoft.scene import scene_from_dict

STEP = 0.01


class Pusher(Controller):
    """Moves the base by 1 mm at every "+", or to where its slider "s" stands; notes when it was asked."""

    interactive = True

    def __init__(self) -> None:
        self.called: list[int] = []
        self.resets = 0

    def reset(self, model: Any) -> None:
        self.resets += 1
        self.shift = 0.0

    def key(self, event: KeyEvent) -> None:
        self.shift = event.value if event.value is not None else self.shift + {"+": 1.0}.get(event.key, 0.0)

    def control(self, observation: Observation) -> Control:
        self.called.append(observation.step)
        return Control(base_translation=np.array([self.shift, 0.0, 0.0]), signals={"shift": self.shift})


def make_simulation(block: Callable[..., str], **controller: Any) -> Simulation:
    body = {
        "mesh": block((1, 1, 1), (10.0, 10.0, 10.0)),
        "mass": 0.01,
        "young_modulus": 500,
        "poisson_ratio": 0.3,
        "anchors": [{"box": [[-5, -5, -5], [-5, 5, 5]]}],
    }
    scene: dict[str, Any] = {"time": {"step": STEP, "duration": 0.1}, "soft_bodies": {"block": body}}
    if controller:
        scene["controller"] = {"name": "none", **controller}
    return Simulation(scene_from_dict(scene))


@pytest.fixture
def simulation(block: Callable[..., str]) -> Simulation:
    return make_simulation(block)


def press_at(session: Session, keys: dict[int, str]) -> Callable[[StepReport], None]:
    """Presses keys when so many steps are made."""

    def on_step(report: StepReport) -> None:
        for key in keys.get(session.steps_made, ""):
            session.keys.put(KeyEvent({"_": "space", "!": "escape"}.get(key, key)))

    return on_step


def played(simulation: Simulation, folder: Path | None, keys: dict[int, str], **options: Any) -> tuple[str, Session]:
    """A session with keys pressed after some steps."""
    session = Session(simulation, Pusher(), folder=folder, **options)
    return run_session(session, press_at(session, keys)), session


def test_keys_reach_controller_before_step(simulation: Simulation) -> None:
    outcome, session = played(simulation, None, {2: "+", 4: "++"})
    assert outcome == "completed"
    assert simulation.state.base_translation[0] == 3.0
    assert [event.key for event in session.recent_keys] == ["+", "+", "+"]


def test_replay_gives_same_bits(block: Callable[..., str], tmp_path: Path) -> None:
    """Pauses, single steps and a new start included."""
    first, second = make_simulation(block), make_simulation(block)
    outcome, session = played(first, tmp_path / "a", {2: "+s", 3: "+_", 5: "+r", 9: "+?", 12: "!"}, duration=np.inf)
    assert outcome == "stopped" and session.steps_made == 12 and first.state.step == 7
    replay = KeyReplay(tmp_path / "a" / "keys.jsonl")
    assert played(second, tmp_path / "b", {}, replay=replay)[0] == "stopped"
    assert second.state == first.state
    assert (tmp_path / "a" / "keys.jsonl").read_text() == (tmp_path / "b" / "keys.jsonl").read_text()


def test_sliders_are_replayed(block: Callable[..., str], tmp_path: Path) -> None:
    """0.1 + 0.2 is a number that only all of its digits give back."""
    first, second = make_simulation(block), make_simulation(block)
    session = Session(first, Pusher(), folder=tmp_path, duration=0.07)
    moves = {2: 1.0, 4: 0.1 + 0.2}

    def on_step(report: StepReport) -> None:
        if session.steps_made in moves:
            session.keys.put(KeyEvent("s", value=moves[session.steps_made]))

    run_session(session, on_step)
    assert first.state.base_translation[0] == 0.1 + 0.2 and not session.paused
    replay = KeyReplay(tmp_path / "keys.jsonl")
    played(second, None, {}, replay=replay)
    assert second.state == first.state


def test_replay_ends_where_run_did(block: Callable[..., str], tmp_path: Path) -> None:
    first, second = make_simulation(block), make_simulation(block)
    played(first, tmp_path, {3: "+"}, duration=0.07)
    outcome, _ = played(second, None, {}, replay=KeyReplay(tmp_path / "keys.jsonl"))
    assert outcome == "completed"
    assert second.state == first.state


def test_escape_ends_run(simulation: Simulation) -> None:
    outcome, session = played(simulation, None, {4: "!"}, duration=np.inf)
    assert outcome == "stopped" and session.steps_made == 4


def test_paused_run_makes_single_steps(simulation: Simulation) -> None:
    seen = []

    class Watch:
        @hookimpl
        def taichisoft_step_done(self, session: Session, report: StepReport) -> None:
            seen.append((report.step, session.paused))
            if session.steps_made in (3, 4):
                session.keys.put(KeyEvent("s"))  # at 3 it also pauses
            elif session.steps_made == 5:
                session.keys.put(KeyEvent("space"))

    watch = Watch()
    register_plugin(watch, "watch")
    try:
        assert played(simulation, None, {})[0] == "completed"
    finally:
        unregister_plugin("watch")
    assert seen == [(k, k in (3, 4)) for k in range(10)]


def test_restart_goes_back_to_first_state(simulation: Simulation) -> None:
    restarts: list[float] = []

    class Log(Output):
        def record(self, state: State, report: StepReport) -> None:
            """Nothing to keep."""

        def restart(self, state: State) -> None:
            restarts.append(state.time)

    outcome, session = played(simulation, None, {4: "+r"}, outputs=[Log()])
    assert (outcome, restarts, session.controller.resets) == ("completed", [0.0], 2)
    assert session.steps_made == 14 and simulation.state.step == 10
    assert simulation.state.base_translation[0] == 0.0


def test_controller_is_called_once_period(block: Callable[..., str]) -> None:
    _, session = played(make_simulation(block, period=0.03), None, {})
    assert session.controller.called == [0, 3, 6, 9]


@pytest.mark.parametrize(
    ("period", "near"), [(0.015, "0.01 or 0.02"), (0.004, "0.01"), (0.0349, "0.03 or 0.04"), (0.0001, "0.01")]
)
def test_period_between_steps_is_refused(block: Callable[..., str], period: float, near: str) -> None:
    with pytest.raises(SceneError) as refused:
        make_simulation(block, period=period)
    wanted = f"controller.period = {period:g} s must be a whole multiple of time.step = 0.01 s, such as {near} s"
    assert wanted in str(refused.value)


def test_slow_controller_ends_run(block: Callable[..., str]) -> None:
    class Slow(Pusher):
        def control(self, observation: Observation) -> Control:
            if observation.step == 3:
                time.sleep(60.0)
            return Control()

    simulation = make_simulation(block, time_limit=0.2)
    with pytest.raises(PluginError) as failure:
        run_session(Session(simulation, Slow()))
    message = str(failure.value)
    assert "Slow took 0.2" in message
    assert message.endswith("s in control() at step 3; controller.time_limit is 0.2 s")
    assert simulation.state.step == 3


def test_controller_may_give_up(simulation: Simulation) -> None:
    class Doubtful(Pusher):
        def control(self, observation: Observation) -> Control:
            raise ControllerFailed("no contact below 150 kPa")

    with pytest.raises(ControllerFailed, match=r"^no contact below 150 kPa$"):
        run_session(Session(simulation, Doubtful()))


def test_report_has_signals(simulation: Simulation) -> None:
    shifts = []
    session = Session(simulation, Pusher())
    press = press_at(session, {2: "+"})
    run_session(session, lambda report: (shifts.append(report.signals["shift"]), press(report)))  # type: ignore[arg-type]
    assert shifts == [0.0] * 2 + [1.0] * 8


def test_hooks_see_begin_steps_and_end_of_failure(simulation: Simulation) -> None:
    calls: list[Any] = []

    class Watch:
        @hookimpl
        def taichisoft_run_begins(self, session: Session) -> None:
            calls.append("begins")

        @hookimpl
        def taichisoft_step_done(self, report: StepReport) -> None:
            calls.append(report.step)
            if report.step == 2:
                raise OSError("no light")

        @hookimpl
        def taichisoft_run_ends(self, outcome: str) -> None:
            calls.append(outcome)

    watch = Watch()
    register_plugin(watch, "watch")
    try:
        with pytest.raises(
            PluginError, match=r"^plug-in 'watch' .* failed in taichisoft_step_done\(\): OSError: no light"
        ):
            run_session(Session(simulation, Pusher()))
    finally:
        unregister_plugin("watch")
    assert calls[:4] == ["begins", 0, 1, 2]
    assert len(calls) == 5 and "no light" in calls[4]
