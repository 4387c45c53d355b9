"""What a recording holds stays readable: damaged, killed, on a full disk; damage is told, and what is whole rescued."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import fake_run
import numpy as np
import pytest
import tiny_run
from conftest import PATIENCE
from damage import DAMAGES, cut_off, flip_bit
from hypothesis import given, settings
from hypothesis import strategies as st

from taichisoft_outputs import Recording, RecordingError, read_recording
from taichisoft_outputs.recording.recording_output import RecordingOutput

STEPS = 250
KILLED_STEPS = 20
WRITERS = ("recording/recording_file.py", "recording/recording_output.py", "base/files.py")

FULL_DISK = """
import resource, sys
from taichisoft.command_line import main
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv.pop(1)), resource.RLIM_INFINITY))
main()
"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole")
    fake_run.fake_run([RecordingOutput(folder)], STEPS)
    return folder / "recording.h5"


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of as many steps that nobody has closed, but for the last step."""
    return fake_run.begun(RecordingOutput(tmp_path_factory.mktemp("killed")), range(1, STEPS + 2)).path


def check_instants(recording: Recording) -> None:
    """Instants at the start, in the middle and at the end are what was computed."""
    count = recording.instant_count
    for number in {0, count // 2, *range(max(0, count - 3), count)}:
        fake_run.check_instant(recording, number, number)
        assert recording.row("iterations", number) == number


@settings(deadline=None, max_examples=120)
@given(seed=st.integers(0, 2**32), kind=st.sampled_from(DAMAGES), finished=st.booleans())
def test_damage_is_never_read_as_true(recorded: Path, killed: Path, seed: int, kind, finished: bool) -> None:
    """It is an error of one line; of a killed recording the end may be missing, as if it had been killed before."""
    path = recorded if finished else killed
    broken = path.with_name("broken.h5")
    broken.write_bytes(kind(bytearray(path.read_bytes()), random.Random(seed)))
    try:
        with read_recording(broken) as recording:
            rows = recording.rows_of_instants(0, recording.instant_count)
            assert recording.instant_count == STEPS + 1 or not finished
            assert np.array_equal(rows["steps/step"], np.arange(recording.instant_count))
            assert np.array_equal(recording.soft_bodies[0].rest_position, fake_run.REST)
            assert recording.scene == fake_run.fake_model().scene
            check_instants(recording)
    except RecordingError as error:
        assert "\n" not in str(error) and str(error).startswith(f"{broken}: ")


@pytest.mark.parametrize("finished", [True, False])
def test_repair_keeps_every_whole_instant(recorded: Path, killed: Path, tmp_path: Path, finished: bool) -> None:
    """A damaged position costs its own instant alone while the run goes on; then those that are packed with it."""
    content = bytearray((recorded if finished else killed).read_bytes())
    place = _place_of_positions(recorded) if finished else content.index(fake_run.fake_state(70).velocity.tobytes())
    content[place + 5] ^= 4
    broken, new = tmp_path / "broken.h5", tmp_path / "new.h5"
    broken.write_bytes(content)
    with read_recording(broken) as recording:
        rescue = recording.rescue(new)
    lost = sorted(set(range(STEPS + 1)) - set(rescue.whole))
    assert 70 in lost and len(lost) <= (100 if finished else 1)
    assert rescue.damage.startswith(f"instant {lost[0]}: ") and "what was written" in rescue.damage
    with read_recording(new) as recording:
        assert recording.outcome == f"repaired: {STEPS + 1 - len(lost)} of {STEPS + 1} instants were whole"
        for number, step in enumerate(rescue.whole):
            fake_run.check_instant(recording, number, step)


def test_damage_of_a_running_file_is_told_at_its_end(tmp_path: Path) -> None:
    writer = fake_run.begun(RecordingOutput(tmp_path), range(1, 30))
    with writer.path.open("r+b") as file:
        file.seek(writer.path.read_bytes().index(fake_run.fake_state(20).velocity.tobytes()))
        file.write(b"damage")
    with pytest.warns(UserWarning, match=r"29 of 30 instants are whole: instant 20: fields of instant 20 are not what"):
        writer.end("completed")
    with read_recording(writer.path) as recording:
        assert recording.outcome == "repaired: 29 of 30 instants were whole" and 20 not in recording.column("step")


def _place_of_positions(path: Path) -> int:
    import h5py

    with h5py.File(path) as file:
        positions = file["steps/position"]
        return int(
            positions.id.get_chunk_info_by_coord((70 // positions.chunks[0] * positions.chunks[0], 0, 0)).byte_offset
        )


def test_repair_makes_hdf5_of_a_killed_run(killed: Path, tmp_path: Path) -> None:
    import h5py

    with read_recording(killed) as recording:
        assert recording.rescue(tmp_path / "new.h5").whole == list(range(STEPS + 1))
    with h5py.File(tmp_path / "new.h5") as file:
        assert file.attrs["outcome"] == b"unfinished"
        assert file["steps/step"][:].tolist() == list(range(STEPS + 1))


def test_repair_rescues_what_is_before_a_cut(recorded: Path, tmp_path: Path) -> None:
    content = recorded.read_bytes()
    (tmp_path / "cut.h5").write_bytes(content[: -len(content) // 10])
    with read_recording(tmp_path / "cut.h5") as recording:
        rescue = recording.rescue(tmp_path / "new.h5")
    assert rescue.whole[:100] == list(range(100)) and len(rescue.whole) < STEPS
    with read_recording(tmp_path / "new.h5") as recording:
        fake_run.check_instant(recording, 99, 99)


def test_repair_changes_nothing_of_a_whole_recording(recorded: Path, tmp_path: Path) -> None:
    result = tiny_run.command("recording", "repair", recorded, "-o", tmp_path / "new.h5")
    assert result.output.splitlines() == [f"{tmp_path / 'new.h5'}: {STEPS + 1} of {STEPS + 1} instants"]
    with read_recording(recorded) as one, read_recording(tmp_path / "new.h5") as other:
        assert other.outcome == one.outcome and other.scene == one.scene
        assert other.contact_pairs(2) == one.contact_pairs(2) == [("finger", "cube")] * 2
        rows = other.rows_of_instants(0, STEPS + 1)
        for path, values in one.rows_of_instants(0, STEPS + 1).items():
            assert rows[path].tobytes() == values.tobytes(), path


def test_repair_refuses_in_one_line(tmp_path: Path, recorded: Path) -> None:
    (tmp_path / "text.h5").write_text("no HDF5")
    for run, new, message in (
        (tmp_path / "text.h5", tmp_path / "new.h5", "not readable as HDF5"),
        (recorded, recorded, "is the damaged recording; name another file"),
        (tmp_path / "none.h5", tmp_path / "new.h5", "no such recording"),
    ):
        error = tiny_run.command("recording", "repair", run, "-o", new).exception
        assert isinstance(error, RecordingError) and message in str(error) and "\n" not in str(error)


@pytest.mark.parametrize("kind", [cut_off, flip_bit])
@pytest.mark.parametrize("command", ["export", "plot", "render", "report", "resume", "view"])
def test_every_command_tells_damage_in_one_line(tmp_path: Path, recorded: Path, kind, command: str) -> None:
    broken = tmp_path / "recording.h5"
    content = recorded.read_bytes()
    broken.write_bytes(content[:20000] if kind is cut_off else b"\x89HDG" + content[4:])
    started = time.monotonic()
    result = tiny_run.command("recording", command, broken)
    assert isinstance(result.exception, RecordingError), result.exception
    assert "\n" not in str(result.exception)
    assert f"taichisoft recording repair {broken} -o NEW.h5" in str(result.exception)
    assert time.monotonic() - started < PATIENCE


def test_a_finished_file_is_no_longer_than_its_content(recorded: Path) -> None:
    assert recorded.stat().st_size < 200_000


# Writers that are killed, readers beside them, and a full disk.


@contextmanager
def endless_writer(folder: Path) -> Iterator[None]:
    """A process that records until it is killed, at the end of the `with` statement."""
    writer = subprocess.Popen([sys.executable, fake_run.__file__, str(folder)], stdout=subprocess.PIPE, text=True)
    assert writer.stdout is not None
    try:
        assert writer.stdout.readline() == "begun\n"
        yield
    finally:
        writer.kill()
        writer.wait()
        writer.stdout.close()


@pytest.mark.parametrize("after", [0.0, 0.013, 0.11, 0.29])
def test_a_killed_writer_leaves_a_readable_file(tmp_path: Path, after: float) -> None:
    with endless_writer(tmp_path):
        time.sleep(after)
    with read_recording(tmp_path / "recording.h5") as recording:
        assert recording.outcome == "unfinished" and recording.instant_count >= 1
        check_instants(recording)


def test_another_process_reads_what_is_being_written(tmp_path: Path) -> None:
    seen: list[int] = []
    with endless_writer(tmp_path), read_recording(tmp_path / "recording.h5") as running:
        while len(seen) < 3:
            running.refresh()
            if seen and running.instant_count == seen[-1]:
                continue
            seen.append(running.instant_count)
            assert running.outcome == "unfinished"
            assert running.times[-1] == (running.instant_count - 1) * fake_run.STEP
            check_instants(running)
    assert seen == sorted(seen) and seen[-1] > seen[0]


def test_a_step_is_written_when_the_next_one_comes(tmp_path: Path) -> None:
    writer = fake_run.begun(RecordingOutput(tmp_path), (1, 2, 3))
    with read_recording(tmp_path / "recording.h5") as running:
        assert running.instant_count == 3
        fake_run.check_instant(running, 2, 2)
    writer.end("completed")


def test_a_full_disk_ends_the_run_in_one_line(falling_cube, tmp_path: Path) -> None:
    """All instants before it stay."""
    command = ["run", str(falling_cube), "--controller", "scripted", "--set", "controller.settings.script='rest'"]
    command += ["--output", str(tmp_path), "--duration", "20"]
    run = subprocess.run(
        [sys.executable, "-c", FULL_DISK, "900000", *command], capture_output=True, text=True, timeout=PATIENCE
    )
    assert run.returncode == 2, run.stderr
    assert run.stderr == f"taichisoft: {tmp_path / 'recording.h5'}: cannot be written: File too large\n"
    with read_recording(tmp_path / "recording.h5") as recording:
        assert recording.instant_count > 100
        assert "cannot be written" in recording.outcome
        assert np.isfinite(recording.column("rigid_position")).all()
        assert np.array_equal(recording.column("step"), np.arange(recording.instant_count))
    assert "cannot be written" in json.loads((tmp_path / "metrics.json").read_text())["outcome"]


def record(folder: Path) -> None:
    """Begin, write and close a recording."""
    fake_run.fake_run([RecordingOutput(folder)], KILLED_STEPS)


def lines_before_the_end(function: Callable[[], None], limit: int) -> int:
    """Call it in a process of its own that is killed after so many lines of the recording's modules.

    Returns:
        How many of them were left to it; 0 where it was killed.
    """
    child = os.fork()
    if child == 0:
        left = limit

        def count(frame, event, argument):
            nonlocal left
            if not frame.f_code.co_filename.endswith(WRITERS):
                return None
            if event == "line":
                left -= 1
                if left == 0:
                    os.kill(os.getpid(), signal.SIGKILL)
            return count

        sys.settrace(count)
        function()
        sys.settrace(None)
        Path(f"{limit}.left").write_text(str(left))
        os._exit(0)
    killed = os.WIFSIGNALED(os.waitpid(child, 0)[1])
    return 0 if killed else int(Path(f"{limit}.left").read_text())


def test_a_kill_at_any_line_leaves_the_older_or_the_new(tmp_path: Path, monkeypatch) -> None:
    """In the middle of beginning and of closing, too; nothing of the killed stays when another run has begun."""
    monkeypatch.chdir(tmp_path)
    fake_run.fake_run([RecordingOutput(tmp_path)], 1)
    many = 10**6
    total = many - lines_before_the_end(lambda: record(tmp_path / "whole"), many)
    left = set()
    for limit in [*range(2, total, total // 12), *range(total - 8, total)]:
        assert lines_before_the_end(lambda: record(tmp_path), limit) == 0
        with read_recording(tmp_path / "recording.h5") as recording:
            left.add((recording.outcome, recording.instant_count))
            fake_run.check_instant(recording, recording.instant_count - 1, recording.instant_count - 1)
    unfinished = {("unfinished", count) for count in range(1, KILLED_STEPS + 2)}
    assert left <= {("completed", 2), ("completed", KILLED_STEPS + 1)} | unfinished
    assert len(left & unfinished) > 2 and left - unfinished == {("completed", 2), ("completed", KILLED_STEPS + 1)}
    record(tmp_path)
    assert not list(tmp_path.glob(".*.partial")), "left by those who were killed"
