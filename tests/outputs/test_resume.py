"""A run that goes on from a recording repeats the recorded bits, those of its controller too; others are refused."""

import json
import re
import shutil
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st

from taichisoft import (
    Control,
    Controller,
    Force,
    KeyEvent,
    Session,
    Simulation,
    hookimpl,
    load_scene,
    register_plugin,
    run,
)
from taichisoft.command_line import main
from taichisoft.errors import PluginError
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.running import Output
from taichisoft.running.loop import run_session, saved_as_json
from taichisoft_controllers.keyboard_controller import KeyboardController
from taichisoft_outputs import read_recording
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.recording.resume import resumed_simulation, state_at

# The pads close, press on the cube, and lift it: contacts and friction are there at 0.3 s.
SCRIPT = """
interpolation = "smooth"
keyframes = [
    { time = 0.0, pressure = 0.0 },
    { time = 0.2, pressure = 9.0 },
    { time = 0.25, pressure = 9.0, base_translation = [0.0, 0.0, 0.0] },
    { time = 0.5, pressure = 9.0, base_translation = [0.0, 0.0, 5.0] },
]
"""


def taichisoft(*arguments):
    """The exit code of the command."""
    before, sys.argv = sys.argv, ["taichisoft", *map(str, arguments)]
    try:
        main()
    except SystemExit as ended:
        return ended.code
    finally:
        sys.argv = before
    return 0


@pytest.fixture(scope="module")
def straight(tmp_path_factory):
    """Folder of a run of half a second, whose scene and mesh are gone afterwards."""
    folder = tmp_path_factory.mktemp("resume")
    shutil.copytree(TINY_GRIPPER.parent, folder / "scene")
    (folder / "grasp.toml").write_text(SCRIPT)
    script = f"controller.settings.script='{folder / 'grasp.toml'}'"
    output = folder / "straight"
    scene = folder / "scene" / "scene.toml"
    assert taichisoft("run", scene, "--controller", "scripted", "--set", script, "--output", output) == 0
    shutil.rmtree(folder / "scene")
    return output


def resume(straight, *arguments):
    return taichisoft("resume", straight / "recording.h5", *arguments)


@pytest.mark.parametrize("moment", [0.0, 0.1, 0.33])
def test_a_resumed_run_is_the_one_that_went_straight_on(straight, tmp_path, moment):
    assert resume(straight, "--at", moment, "--output", tmp_path) == 0
    with read_recording(straight / "recording.h5") as whole, read_recording(tmp_path / "recording.h5") as rest:
        first = whole.instant_at(moment)
        assert rest.instant_count == whole.instant_count - first == 51 - round(moment / 0.01)
        assert rest.state(0) == state_at(whole, first)
        assert rest.state(rest.instant_count - 1) == whole.state(whole.instant_count - 1)
        assert np.array_equal(rest.column("position"), whole.column("position")[first:])
        if moment > 0.3:
            assert len(rest.contacts(0)[0]) and rest.row("normal_force", 0).max() > 0.0
        for name in ("pressure", "normal_force", "friction_force", "slip_speed", "contact_count"):
            a, b = whole.column(name)[first:], rest.column(name)
            assert ((a == b) | (a != a)).all(), name


def test_a_resumed_run_can_be_resumed(straight, tmp_path):
    assert resume(straight, "--at", 0.1, "--duration", 0.1, "--output", tmp_path / "a", "--every", 7) == 0
    assert taichisoft("resume", tmp_path / "a" / "recording.h5", "--output", tmp_path / "b") == 0
    with read_recording(straight / "recording.h5") as whole, read_recording(tmp_path / "b" / "recording.h5") as rest:
        assert rest.times[0] == 0.2 and rest.state(30) == whole.state(50)


def test_a_run_goes_on_between_frames_that_are_steps_apart(straight, tmp_path):
    """From a frame without a state, after steps that are no frames: while the base moves under a limit."""
    limits = ("--set", "limits={base_speed=5.0, pressure_rate=40.0}")
    assert resume(straight, "--at", 0.02, *limits, "--output", tmp_path / "a", "--every", 4) == 0
    assert taichisoft("resume", tmp_path / "a" / "recording.h5", "--at", 0.3, "--output", tmp_path / "b") == 0
    with (
        read_recording(tmp_path / "a" / "recording.h5") as whole,
        read_recording(tmp_path / "b" / "recording.h5") as rest,
    ):
        first = whole.instant_at(0.3)
        assert not whole.has_state(first) and whole.row("control_count", first) == 3
        assert (whole.row("frame_request", first) != whole.row("frame_pose", first)).any()
        assert rest.row("frame_request", 0).tolist() == whole.row("frame_request", first).tolist()
        assert rest.state(rest.instant_count - 1) == whole.state(whole.instant_count - 1)


def test_gravity_that_is_changed_is_that_of_the_rest(straight, tmp_path):
    """Although a state has a gravity of its own: that of the scene that was recorded, or what a controller set."""
    changed = ("--at", 0.1, "--duration", 0.02, "--output", tmp_path, "--set", "gravity=[0.0,0.0,-1.0]")
    assert resume(straight, *changed) == 0
    with read_recording(straight / "recording.h5") as whole, read_recording(tmp_path / "recording.h5") as rest:
        assert whole.state(10).gravity.tolist() == list(whole.scene.gravity) != [0.0, 0.0, -1.0]
        assert all(rest.row("gravity", frame).tolist() == [0.0, 0.0, -1.0] for frame in range(3))


def test_the_folder_is_beside_that_of_the_recording(straight):
    assert resume(straight, "--at", 0.42, "--duration", 0.01) == 0
    assert (straight.with_name("straight-from-0.42s") / "recording.h5").is_file()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "at 0.5 s the run of 0.5 s is over; say with --duration"),
        (["--at", "0.7"], "nothing at 0.7 s; the recording has from 0 s to 0.5 s"),
        (
            ["--at", "0.3", "--set", "soft_bodies.right.translation=[26.0, 0.0, 11.0]"],
            "'right' is not as it was recorded: its rest positions differ by up to 1 mm",
        ),
        (
            ["--at", "0.3", "--set", "rigid_bodies.cube.box=[9.0, 10.0, 10.0]"],
            "'cube' is not as it was recorded: its surface points differ by up to 0.5 mm",
        ),
        (
            ["--at", "0.3", "--set", "rigid_bodies.ball={box=[1.0,1.0,1.0],mass=1.0,position=[0.0,90.0,9.0]}"],
            "has rigid body cube, the scene rigid body cube, ball",
        ),
        (
            ["--at", "0.3", "--set", "soft_bodies.left.cavities={}"],
            "has cavity left.cavity, right.cavity, the scene cavity right.cavity",
        ),
        (["--at", "0.3", "--set", "time.step=0.02"], "the state belongs to another model: 30 steps took 0.3 s"),
        (["--at", "0.3", "--set", "contact.friction=-1.0"], "contact.friction"),
    ],
)
def test_what_cannot_go_on_is_an_error_of_one_line(straight, tmp_path, capsys, arguments, message):
    assert resume(straight, *arguments, "--output", tmp_path / "new") == 2
    said = capsys.readouterr().err
    assert message in said and said.count("\n") == 1 and "recording.h5" in said
    assert not (tmp_path / "new").exists()


def test_the_recording_is_never_replaced(straight, capsys):
    before = (straight / "recording.h5").stat()
    assert resume(straight, "--at", 0.3, "--output", straight) == 2
    assert "would replace the recording" in capsys.readouterr().err
    assert (straight / "recording.h5").stat() == before


def test_other_settings_than_the_recorded_ones_may_be_tried(straight, tmp_path):
    assert resume(straight, "--at", 0.3, "--set", "contact.friction=0.0", "--output", tmp_path) == 0
    with read_recording(straight / "recording.h5") as whole, read_recording(tmp_path / "recording.h5") as rest:
        assert rest.row("rigid_position", -1)[0, 2] < whole.row("rigid_position", -1)[0, 2] - 1.0, "the cube slips"


# The controller goes on as it was: what it remembers is in the recording.


SCRIPT_OF_STEPS = """
interpolation = "smooth"
[[steps]]
pressure = 20.0
pressure_rate = 30.0
until = "contact_force > 60"
timeout = 1.0
hold = 0.1
[[steps]]
base_translation = [0.0, 0.0, 8.0]
duration = 0.4
"""
CLOSED_LOOP = {"set_point": 60.0, "proportional_gain": 0.0025, "lift": 10.0, "lift_time": 0.6, "hold": 0.2}
"""With a cube of 10 g that slips at first, so that the set point is raised."""


def settings_of(folder: Path, controller: str) -> list[str]:
    """Arguments of `taichisoft run` for the tiny gripper."""
    if controller == "scripted":
        (folder / "steps.toml").write_text(SCRIPT_OF_STEPS)
        settings: dict[str, Any] = {"script": f"'{folder / 'steps.toml'}'"}
    else:
        settings = CLOSED_LOOP
    given = [f"controller.settings.{key}={value}" for key, value in settings.items()]
    return [arg for one in [*given, "rigid_bodies.cube.mass=0.01"] for arg in ("--set", one)]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The folder of a run of 2.1 s by the closed loop, which holds the cube at its end."""
    folder = tmp_path_factory.mktemp("closed-loop")
    arguments = [*settings_of(folder, "closed-loop"), "--duration", 2.1, "--output", folder / "whole"]
    assert taichisoft("run", TINY_GRIPPER, "--controller", "closed-loop", *arguments) == 0
    return folder / "whole"


@pytest.fixture(scope="module")
def script(tmp_path_factory):
    """The folder of a run by a script of steps, the first of which waits for a force."""
    folder = tmp_path_factory.mktemp("script")
    arguments = [*settings_of(folder, "scripted"), "--duration", 1.2, "--output", folder / "whole", "--every", 3]
    assert taichisoft("run", TINY_GRIPPER, "--controller", "scripted", *arguments) == 0
    return folder / "whole"


def assert_goes_on(folder: Path, resumed: Path, moment: float) -> None:
    """A run that goes on has the bits of the one that was not interrupted: states, signals and what is remembered."""
    with read_recording(folder / "recording.h5") as before, read_recording(resumed / "recording.h5") as after:
        first, last = before.instant_at(moment), before.instant_at(float(after.times[-1]))
        assert after.controller_state(0) == before.controller_state(first)
        assert after.controller_state(-1) == before.controller_state(last) is not None
        assert after.state(-1) == state_at(before, last)
        _, of_before, of_after = np.intersect1d(before.column("step"), after.column("step"), return_indices=True)
        assert len(of_after) > 3
        signals = before.column("signals")[of_before], after.column("signals")[of_after]
        assert np.array_equal(signals[0][1:], signals[1][1:], equal_nan=True), "the first frame of a run has none"


@pytest.mark.parametrize(("moment", "phase"), [(0.43, "GRIP"), (1.13, "LIFT"), (1.9, "HELD")])
def test_a_closed_loop_goes_on_in_its_phase_and_keeps_the_cube(whole, tmp_path, capsys, moment, phase):
    from taichisoft_controllers.closed_loop import Phase

    arguments = ("--at", moment, "--duration", 0.2, "--output", tmp_path)
    assert taichisoft("resume", whole / "recording.h5", *arguments) == 0
    assert f"going on from {moment:g} s\n" in capsys.readouterr().out
    assert_goes_on(whole, tmp_path, moment)
    with read_recording(tmp_path / "recording.h5") as recording:
        assert recording.controller_state(0)["grasp"]["phase"] == Phase[phase]
        if phase == "HELD":
            assert recording.controller_state(0)["grasp"]["set_point"]["raised_count"] > 0
            assert recording.row("rigid_position", -1)[0, 2] > recording.row("rigid_position", 0)[0, 2] - 0.1


def test_a_reset_controller_begins_again(whole, tmp_path):
    arguments = ("--at", 1.9, "--duration", 0.1, "--output", tmp_path, "--reset-controller")
    assert taichisoft("resume", whole / "recording.h5", *arguments) == 0
    with read_recording(tmp_path / "recording.h5") as recording:
        assert recording.controller_state(0)["grasp"]["phase"] == 1


@pytest.mark.parametrize("moment", [0.12, 0.33, 0.7, 1.05])
def test_a_script_goes_on_in_its_step(script, tmp_path, moment):
    """While it waits, while it rests, on the way of the base, after its end; with frames three steps apart."""
    arguments = ("--at", moment, "--duration", 0.15, "--output", tmp_path)
    assert taichisoft("resume", script / "recording.h5", *arguments) == 0
    assert_goes_on(script, tmp_path, moment)


def test_a_script_that_has_become_shorter_is_refused(script, tmp_path, capsys):
    (tmp_path / "short.toml").write_text("[[steps]]\npressure = 3.0\nduration = 1.0\n")
    script_set = f"controller.settings.script='{tmp_path / 'short.toml'}'"
    shorter = ("--set", script_set, "--output", tmp_path / "out", "--duration", 0.03)
    assert taichisoft("resume", script / "recording.h5", "--at", 1.05, *shorter) == 2
    said = capsys.readouterr().err
    assert "short.toml: not the script that the controller followed, which was at steps.2; " in said
    assert taichisoft("resume", script / "recording.h5", "--at", 1.05, *shorter, "--reset-controller") == 0


class Press(Controller):
    """Presses by random amounts, more after each key; one without a memory of its own is derived from it."""

    def reset(self, model: Any) -> None:
        self.random, self.level = np.random.default_rng(7), 0.0

    def control(self, observation: Any) -> Control:
        self.level += self.random.normal(0.2, 0.1)
        return Control(pressure={"left.cavity": self.level})

    def save(self) -> dict[str, Any] | None:
        return {"random": self.random.bit_generator.state, "level": self.level}

    def restore(self, saved: Mapping[str, Any]) -> None:
        self.random.bit_generator.state, self.level = saved["random"], saved["level"]


def test_random_numbers_go_on_where_they_were(tmp_path):
    simulation = Simulation(load_scene(TINY_GRIPPER))
    run(simulation, Press(), [RecordingOutput(tmp_path)], 0.3)
    with read_recording(tmp_path / "recording.h5") as recording:
        frame = recording.instant_at(0.15)
        resumed = resumed_simulation(recording, frame, recording.scene)
        run(resumed, Press(), [], 0.15, saved=recording.controller_state(frame))
        assert resumed.state == simulation.state
        anew = resumed_simulation(recording, frame, recording.scene)
        run(anew, Press(), [], 0.15)
        assert anew.state != simulation.state


class Pusher(Press):
    """Pushes the cube now and then, for some steps, and a pad in its own axes all the time."""

    def reset(self, model: Any) -> None:
        super().reset(model)
        self.point = model.soft_bodies[0].rest_position[-1]

    def control(self, observation: Any) -> Control:
        pressed = super().control(observation)
        forces: dict[str, Force | None] = {"left": Force([0.0, 1.0, 0.0], point=self.point, axes="own")}
        if observation.step % 7 == 3:
            forces["cube"] = Force(self.random.normal(0.0, 2.0, 3), torque=[0.0, 1.0, 0.0], steps=4)
        return replace(pressed, forces=forces if observation.step < 22 else {"left": None})


def test_pushes_go_on_where_they_were(tmp_path):
    """From every instant, between states too, whose steps are made again; an instant has the push that led to it."""
    simulation = Simulation(load_scene(TINY_GRIPPER))
    states = [simulation.state]

    class Kept(Output):
        def record(self, state: Any, report: Any) -> None:
            states.append(state)

    run(simulation, Pusher(), [RecordingOutput(tmp_path, every=3), Kept()], 0.3)
    with read_recording(tmp_path / "recording.h5") as recording:
        assert {recording.has_state(index) for index in range(recording.instant_count)} == {True, False}
        for index in range(recording.instant_count - 1):
            assert state_at(recording, index) == states[3 * index]
            resumed = resumed_simulation(recording, index, recording.scene)
            run(resumed, Pusher(), [], 0.3 - 0.03 * index, saved=recording.controller_state(index))
            assert resumed.state == simulation.state
        assert recording.column("external_force_steps")[:, 2].tolist() == [0, 0, 2, 0, 3, 0, 4, 1, 0, 0, 0]


def test_keys_and_sliders_stay_where_they_were(tmp_path):
    """With a limit of the pressure's rate, so that what was asked for is not yet there; and `r` goes back to that."""
    scene = load_scene(TINY_GRIPPER, ["limits.pressure_rate=10.0"])
    keys = {3: KeyEvent("right.cavity", value=6.0)}
    keys |= {step: KeyEvent(key) for step, key in ((5, "1"), (6, "+"), (7, "up"), (9, "a"))}
    simulation, controller = Simulation(scene), KeyboardController()
    session = Session(simulation, controller, [RecordingOutput(tmp_path)], 0.4)

    def press(report: Any) -> None:
        if report.step in keys:
            session.keys.put(keys[report.step])

    run_session(session, press)
    with read_recording(tmp_path / "recording.h5") as recording:
        frame = recording.instant_at(0.2)
        saved = recording.controller_state(frame)
        resumed, again = resumed_simulation(recording, frame, scene), KeyboardController()
        assert recording.controller_state(0)["sliders"] == {"left.cavity": 0.0, "right.cavity": 0.0}
    rest = Session(resumed, again, [], 0.2, saved=saved)
    rest.keys.put(KeyEvent("q"))
    rest.keys.put(KeyEvent("right.cavity", value=1.0))
    rest.keys.put(KeyEvent("r"))
    run_session(rest)
    assert resumed.state == simulation.state
    assert {name: slider.value for name, slider in again.sliders.items()} == {"left.cavity": 1.0, "right.cavity": 6.0}
    assert again.status == "left selected"


def test_resume_tells_that_a_controller_does_not_save(tmp_path, taichisoft_plugins, capsys):
    class Forgetful(Press):
        def save(self) -> None:
            return None

    class Plugin:
        @hookimpl
        def taichisoft_controllers(self) -> Any:
            return {"forgetful": Forgetful, "remembering": Press}

    register_plugin(Plugin(), "test")
    run_of = ("run", TINY_GRIPPER, "--controller", "forgetful", "--duration", 0.05, "--output", tmp_path / "a")
    assert taichisoft(*run_of) == 0
    again = ("resume", tmp_path / "a" / "recording.h5", "--duration", 0.05)
    assert taichisoft(*again, "--output", tmp_path / "b") == 0
    assert "the controller 'forgetful' begins again, since it does not save" in capsys.readouterr().out
    assert taichisoft(*again, "--controller", "remembering", "--output", tmp_path / "c") == 0
    assert "begins again" not in capsys.readouterr().out


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_subnormal=False) | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=6,
)


class Remembers(Controller):
    def __init__(self, saved: Any):
        self.saved = saved

    def control(self, observation: Any) -> Control:
        return Control()

    def save(self) -> Any:
        return self.saved


@examples(40)
@given(st.dictionaries(st.text(), JSON, max_size=3))
def test_what_is_saved_comes_back_as_it_was(saved):
    again = json.loads(saved_as_json(Remembers(saved)))
    assert again == saved and repr(again) == repr(saved)


@pytest.mark.parametrize(
    ("saved", "message"),
    [
        ([1.0], "save() returned [1.0]; must be a dict, or None"),
        ({"a": {"gains": np.zeros(2)}}, "save(): a.gains = array([0., 0.]): save its `tolist()`"),
        ({"count": np.int64(3)}, "save(): count = np.int64(3): save its `tolist()`"),
        ({"a": [1, {2: 3}]}, "save(): a.1: key 2 must be a text"),
        ({"random": np.random.default_rng(1)}, "save its `bit_generator.state`"),
        ({"one": {1, 2}}, "save(): one = {1, 2}: must be a number, a text, a list, or a dict of these"),
    ],
)
def test_what_json_cannot_hold_is_refused_with_its_place(saved, message):
    with pytest.raises(PluginError, match=re.escape(message)) as refused:
        saved_as_json(Remembers(saved))
    assert "test_resume.Remembers" in str(refused.value) and "\n" not in str(refused.value)


def test_a_controller_that_cannot_be_saved_is_named(tmp_path):
    simulation = Simulation(load_scene(TINY_GRIPPER))
    with pytest.raises(PluginError, match=r"Remembers: save\(\): a = "):
        run(simulation, Remembers({"a": np.zeros(1)}), [RecordingOutput(tmp_path)], 0.05)
    with pytest.raises(PluginError, match=r"Remembers has save\(\) without restore\(\); write both, or neither"):
        run(simulation, Remembers({}), [], 0.05, saved={"a": 1})

    class Broken(Press):
        def save(self) -> Any:
            raise KeyError("gain")

    with pytest.raises(PluginError, match=r"Broken failed in save\(\): KeyError: 'gain'"):
        run(simulation, Broken(), [RecordingOutput(tmp_path)], 0.05)
    with pytest.raises(PluginError, match=r"Press failed in restore\(\): KeyError: 'random'"):
        run(simulation, Press(), [], 0.05, saved={"level": 1.0})
