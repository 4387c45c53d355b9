"""The loop around the step: what is called when, and what is kept when a plug-in fails or the user stops it."""

import math
import re
import signal
import sys
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from taichisoft import Control, Controller, Output, Simulation, run
from taichisoft.errors import ControlError, GoalMissed, PluginError, PluginFailed, SimulationDiverged, TaichisoftError
from taichisoft.running.session import count_steps
from taichisoft.scene import scene_from_dict
from taichisoft_outputs.recording.recording_output import RecordingOutput

STEP = 0.01


class Rest(Controller):
    """A controller that asks for nothing, or does something else in one step."""

    def __init__(self, at_step: int = -1, act: Any = None):
        self.at_step, self.act = at_step, act

    def control(self, observation: Any) -> Any:
        return self.act() if observation.step == self.at_step else Control()


class Log(Output):
    """An output that notes its calls, and does something else after one step or at the end."""

    def __init__(self, after_step: int = -1, act: Any = None, at_end: Any = None):
        self.calls: list[Any] = []
        self.after_step, self.act, self.at_end = after_step, act, at_end

    def begin(self, model: Any, state: Any) -> None:
        self.calls.append(("begin", state.step))

    def record(self, state: Any, report: Any) -> None:
        if report.step == self.after_step:
            self.act()
        self.calls.append((state.step, report.step))

    def end(self, outcome: str) -> None:
        self.calls.append(outcome)
        if self.at_end is not None:
            raise self.at_end


@pytest.fixture
def simulation() -> Simulation:
    return Simulation(
        scene_from_dict(
            {"time": {"step": STEP, "duration": 0.05}, "rigid_bodies": {"cube": {"box": [1] * 3, "mass": 1}}}
        )
    )


def recorded(folder: Path) -> tuple[str, list[int]]:
    """Outcome and steps of the recording in a folder."""
    import h5py

    with h5py.File(folder / "recording.h5") as file:
        return file.attrs["outcome"].decode(), file["steps/step"][:].tolist()


def fail() -> None:
    raise ZeroDivisionError("no air left")


def test_outputs_see_start_steps_and_end(simulation: Simulation) -> None:
    first, second = Log(), Log()
    seen: list[int] = []
    assert run(simulation, Rest(), [first, second], on_step=lambda report: seen.append(report.step)) == "completed"
    assert first.calls == second.calls == [("begin", 0), *((k + 1, k) for k in range(5)), "completed"]
    assert seen == [0, 1, 2, 3, 4]


@pytest.mark.parametrize(
    ("duration", "step", "count"),
    [
        (1.0, 0.01, 100),
        (0.014, 0.01, 1),
        (0.016, 0.01, 2),
        (1e-9, 0.01, 1),
        (6.2, 0.01, 620),
        (math.inf, 0.01, math.inf),
    ],
)
def test_duration_is_whole_number_of_steps(duration: float, step: float, count: int) -> None:
    assert count_steps(duration, step) == count


@pytest.mark.parametrize("duration", [0.0, -1.0, math.nan])
def test_wrong_duration_is_refused(simulation: Simulation, duration: float) -> None:
    with pytest.raises(TaichisoftError, match=r"^duration = .*: must be a positive number of seconds$"):
        run(simulation, Rest(), duration=duration)


def test_failed_controller_is_named_and_recording_kept(simulation: Simulation, tmp_path: Path) -> None:
    log = Log()
    with pytest.raises(PluginError) as failure:
        run(simulation, Rest(3, fail), [RecordingOutput(tmp_path), log])
    message = str(failure.value)
    assert message.startswith(
        "controller test_run.Rest failed in control(): ZeroDivisionError: no air left (test_run.py"
    )
    assert isinstance(failure.value.__cause__, ZeroDivisionError)
    assert log.calls[-1] == message
    assert recorded(tmp_path) == (message, [0, 1, 2, 3])


def test_failed_output_is_named_and_others_end(simulation: Simulation, tmp_path: Path) -> None:
    log = Log(2, fail)
    with pytest.raises(
        PluginError, match=r"^output test_run\.Log failed in record\(\): ZeroDivisionError: no air left"
    ):
        run(simulation, Rest(), [RecordingOutput(tmp_path), log])
    assert recorded(tmp_path)[1] == [0, 1, 2, 3]
    assert len(log.calls) == 4  # begin, two steps, end


def test_failure_matters_more_than_missed_goal(simulation: Simulation) -> None:
    missed, broken, last = Log(at_end=GoalMissed("not held")), Log(at_end=OSError("disk full")), Log()
    with (
        pytest.warns(UserWarning, match="^not held$"),
        pytest.raises(PluginError, match=r"^output test_run\.Log failed in end\(\): OSError: disk full"),
    ):
        run(simulation, Rest(), [missed, broken, last])
    assert last.calls[-1] == "completed"


class Leaving(BaseException):
    """What no `except Exception` catches."""


@pytest.mark.parametrize("method", ["begin", "record", "end"])
@pytest.mark.parametrize("raised", [SystemExit(0), SystemExit("no light"), Leaving("now")])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_other_outputs_end_whatever_is_raised(
    simulation: Simulation, method: str, raised: BaseException, place: int
) -> None:
    """In any order of theirs: with those before and after it."""

    def leave(*_: Any) -> None:
        raise raised

    leaving = Log()
    setattr(leaving, method, leave)
    leave.__name__ = method
    outputs = [Log(), Log()]
    outputs.insert(place, leaving)
    with pytest.raises(PluginFailed, match=rf"^output test_run\.Log failed in {method}\(\): {type(raised).__name__}"):
        run(simulation, Rest(), outputs)
    for number, log in enumerate(outputs):
        begun = method != "begin" or number < place
        assert log is leaving or not begun or isinstance(log.calls[-1], str)


@pytest.mark.parametrize("raised", [SystemExit(0), Leaving("now")])
def test_controller_that_exits_has_failed(simulation: Simulation, raised: BaseException) -> None:
    def leave() -> None:
        raise raised

    log = Log()
    with pytest.raises(
        PluginFailed, match=rf"^controller test_run\.Rest failed in control\(\): {type(raised).__name__}"
    ):
        run(simulation, Rest(2, leave), [log])
    assert log.calls[-1].startswith("controller test_run.Rest failed in control()")


def test_interrupted_end_leaves_no_output_open(simulation: Simulation) -> None:
    first, second = Log(at_end=KeyboardInterrupt()), Log()
    with pytest.raises(KeyboardInterrupt):
        run(simulation, Rest(), [first, second])
    assert second.calls[-1] == "completed"


def test_missed_goal_reaches_caller(simulation: Simulation) -> None:
    with pytest.raises(GoalMissed, match=r"^not held$"):
        run(simulation, Rest(), [Log(at_end=GoalMissed("not held"))])


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGINT)])
def test_signal_waits_until_outputs_have_step(simulation: Simulation, number: signal.Signals) -> None:
    before = signal.getsignal(number)
    first, second = Log(1, lambda: signal.raise_signal(number)), Log()
    assert run(simulation, Rest(), [first, second]) == "interrupted"
    assert first.calls == second.calls == [("begin", 0), (1, 0), (2, 1), "interrupted"]
    assert signal.getsignal(number) is before


def test_second_signal_does_not_wait(simulation: Simulation) -> None:
    def twice() -> None:
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)

    log = Log(1, twice)
    assert run(simulation, Rest(), [log]) == "interrupted"
    assert log.calls == [("begin", 0), (1, 0), "interrupted"]


@pytest.mark.skipif(sys.platform == "win32", reason="has no hang-up")
def test_second_hang_up_waits_for_step(simulation: Simulation) -> None:
    """A terminal that closes sends two: to its programs, and through the shell."""

    def twice() -> None:
        signal.raise_signal(signal.SIGHUP)
        signal.raise_signal(signal.SIGHUP)

    first, second = Log(1, twice), Log()
    assert run(simulation, Rest(), [first, second]) == "interrupted"
    assert first.calls == second.calls == [("begin", 0), (1, 0), (2, 1), "interrupted"]


def test_ignored_signal_stays_ignored(simulation: Simulation) -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        assert run(simulation, Rest(1, lambda: signal.raise_signal(signal.SIGINT) or Control())) == "completed"
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (None, "controller test_run.Rest at step 2: control() returned None; must return a taichisoft.Control"),
        ({}, "controller test_run.Rest at step 2: control = {}: must be a taichisoft.Control"),
        (0, "controller test_run.Rest at step 2: control = 0: must be a taichisoft.Control"),
        ({"pressure": 3}, "control = {'pressure': 3}: must be a taichisoft.Control"),
        (Control(pressure=3.0), "control.pressure: must be a dictionary by name, not float"),  # type: ignore[arg-type]
        (Control(pressure={"x": 3.0}), "control.pressure: no cavity is called 'x'; there are: none"),
        (Control(pressure={"x": 1.0}, volume_growth={"x": 1.0}), "cavity 'x' is given a pressure and a volume growth"),
        (
            Control(base_translation=np.array([0, 0, np.nan])),
            "control.base_translation = array([ 0.,  0., nan]): must be ",
        ),
        (Control(base_rotation=np.zeros(2)), "control.base_rotation = array([0., 0.]): must be 3 finite numbers"),
        (Control(base_rotation="left"), "control.base_rotation = 'left': must be a number or"),  # type: ignore[arg-type]
    ],
)
def test_impossible_request_is_refused(simulation: Simulation, answer: Any, message: str) -> None:
    with pytest.raises(ControlError) as refused:
        run(simulation, Rest(2, lambda: answer))
    assert message in str(refused.value)
    assert simulation.state.step == 2


def test_small_body_falls_freely(simulation: Simulation) -> None:
    """After 0.6 s of free fall a cube of 1 mm moves by 59 mm in a step of 10 ms."""
    assert run(simulation, Rest(), duration=0.6) == "completed"
    assert simulation.state.rigid_velocity[0, 2] == pytest.approx(-9810 * 0.6)


def test_thrown_body_has_exploded() -> None:
    """The last good state stays; body, step and advice are said."""
    force = {"body": "cube", "force": [1e6, 0.0, 0.0], "start": STEP, "duration": STEP}  # 100 mm in a step of 10 ms
    cube = {"box": [1] * 3, "mass": 1}
    scene = {"time": {"step": STEP}, "rigid_bodies": {"cube": cube}, "external_forces": [force]}
    simulation = Simulation(scene_from_dict(scene))
    with pytest.raises(SimulationDiverged) as diverged:
        run(simulation, Rest())
    assert str(diverged.value).startswith("step 1: body 'cube' exploded: it would move 100 mm in one step")
    assert "try a smaller time.step" in str(diverged.value)
    assert simulation.state.step == 1


class LooksLikeBoth:
    """Has the methods, but none of the base classes."""

    def reset(self, model: Any) -> None: ...

    def control(self, observation: Any) -> Control:
        return Control()

    def begin(self, model: Any, state: Any) -> None: ...

    def record(self, state: Any, report: Any) -> None: ...

    def end(self, outcome: str) -> None: ...

    def __repr__(self) -> str:
        return "<both>"


def test_parts_without_base_class_are_refused(simulation: Simulation) -> None:
    both: Any = LooksLikeBoth()
    for controller, outputs, base in ((both, [], "Controller"), (Rest(), [Log(), both], "Output")):
        kind = f"taichisoft.{base}"
        message = f"<both> is not a {kind}; derive its class, {__name__}.LooksLikeBoth, from {kind}"
        with pytest.raises(PluginError, match=f"^{re.escape(message)}$"):
            run(simulation, controller, outputs)
        assert simulation.state.step == 0
    with pytest.raises(PluginError, match=rf"^{__name__}.Rest is a class; give an object of it$"):
        run(simulation, cast(Any, Rest))


def test_controller_must_have_control() -> None:
    class Mute(Controller):
        pass

    with pytest.raises(TypeError, match=r"abstract method '?control"):
        Mute()  # type: ignore[abstract]


def test_run_is_function_of_package() -> None:
    """A module of the same name would take its place on its first import."""
    import taichisoft

    assert callable(taichisoft.run)
