"""A run that goes on from a recording is the run that was recorded, to the bit; another one is refused."""

import shutil
import sys

import numpy as np
import pytest

from taichisoft.command_line import main
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft_outputs import read_recording
from taichisoft_outputs.recording.resume import state_at

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
