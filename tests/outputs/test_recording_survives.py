"""What a recording holds stays readable: while it is written, when its writer is killed, when the disk is full."""

import json
import subprocess
import sys
import time

import fake_run
import numpy as np
import pytest
from conftest import PATIENCE

from taichisoft_outputs import read_recording
from taichisoft_outputs.recording.recording_output import RecordingOutput

FULL_DISK = """
import resource, sys
from taichisoft.command_line import main
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv.pop(1)), resource.RLIM_INFINITY))
main()
"""


def check_frames(recording):
    """Every frame that counts is what was computed, whole."""
    for frame in {0, recording.frame_count // 2, *range(max(0, recording.frame_count - 3), recording.frame_count)}:
        fake_run.check_frame(recording, frame, frame)
        assert recording.row("iterations", frame) == frame


@pytest.mark.parametrize("after", [0.0, 0.013, 0.11, 0.29])
def test_a_writer_that_is_killed_at_any_moment_leaves_a_readable_file(tmp_path, after):
    writer = subprocess.Popen([sys.executable, fake_run.__file__, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert writer.stdout.readline() == "begun\n"
    time.sleep(after)
    writer.kill()
    writer.wait()
    writer.stdout.close()
    with read_recording(tmp_path / "recording.h5") as killed:
        assert killed.outcome == "unfinished"
        assert killed.frame_count >= 1
        check_frames(killed)


def test_another_process_reads_the_frames_while_they_are_written(tmp_path):
    writer = subprocess.Popen([sys.executable, fake_run.__file__, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    try:
        assert writer.stdout.readline() == "begun\n"
        with read_recording(tmp_path / "recording.h5") as running:
            seen = []
            while len(seen) < 3:
                running.refresh()
                if seen and running.frame_count == seen[-1]:
                    continue
                seen.append(running.frame_count)
                assert running.outcome == "unfinished"
                assert running.times[-1] == (running.frame_count - 1) * fake_run.STEP
                check_frames(running)
    finally:
        writer.kill()
        writer.wait()
        writer.stdout.close()
    assert seen == sorted(seen) and seen[-1] > seen[0]


def test_every_step_is_written_when_the_next_one_comes(tmp_path):
    writer = RecordingOutput(tmp_path)
    writer.begin(fake_run.fake_model(), fake_run.fake_state(0))
    for step in (1, 2, 3):
        writer.record(fake_run.fake_state(step), fake_run.fake_report(step))
    with read_recording(tmp_path / "recording.h5") as running:
        assert running.frame_count == 3
        fake_run.check_frame(running, 2, 2)
    writer.end("completed")


def test_a_full_disk_ends_the_run_with_one_line_and_all_frames_before_it(falling_cube, tmp_path):
    command = ["run", str(falling_cube), "--controller", "scripted", "--set", "controller.settings.script='rest'"]
    command += ["--output", str(tmp_path), "--duration", "20"]
    run = subprocess.run(
        [sys.executable, "-c", FULL_DISK, "900000", *command], capture_output=True, text=True, timeout=PATIENCE
    )
    assert run.returncode == 2, run.stderr
    assert run.stderr == f"taichisoft: {tmp_path / 'recording.h5'}: cannot be written: File too large\n"
    with read_recording(tmp_path / "recording.h5") as recording:
        assert recording.frame_count > 100
        assert "cannot be written" in recording.outcome
        assert np.isfinite(recording.column("rigid_position")).all()
        assert np.array_equal(recording.column("step"), np.arange(recording.frame_count))
    assert "cannot be written" in json.loads((tmp_path / "metrics.json").read_text())["outcome"]


def test_a_finished_file_is_no_longer_than_its_content(tmp_path):
    fake_run.fake_run([RecordingOutput(tmp_path)], steps=200)
    assert (tmp_path / "recording.h5").stat().st_size < 500_000
