"""The folder of a run is the run's alone, and a run whose folder is removed ends with one line."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from conftest import PATIENCE, Command

from taichisoft.running import locked_folder
from taichisoft.running.run_command import FILE_NAME, FolderTaken

HOLDS = """
import sys, time
from pathlib import Path
from taichisoft.running.run_command import locked_folder
with locked_folder(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(1000)
"""


def test_second_run_is_refused_and_killed_one_leaves_folder_free(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    with subprocess.Popen([sys.executable, "-c", HOLDS, str(folder)], stdout=subprocess.PIPE, text=True) as first:
        assert first.stdout is not None and first.stdout.readline() == "held\n"
        with pytest.raises(
            FolderTaken, match=rf"^--output {folder}: a run is going on there \(process {first.pid} on "
        ):
            locked_folder(folder).__enter__()
        first.send_signal(signal.SIGKILL)
    with locked_folder(folder):
        assert os.read(os.open(folder / FILE_NAME, os.O_RDONLY), 99).startswith(f"process {os.getpid()} ".encode())
    assert not list(folder.iterdir())


def test_file_system_without_locks_is_warned_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr("fcntl.flock", refused)
    warning = r"cannot be locked \(Operation not supported\): see that no other run"
    with pytest.warns(UserWarning, match=warning), locked_folder(tmp_path):
        pass


def test_command_refuses_a_taken_folder(falling_cube: Path, tmp_path: Path, command: Command) -> None:
    """Two runs in one folder wrote into the same file; a removed folder was a traceback that blamed the output."""
    folder = tmp_path / "out"
    words = ["run", falling_cube, "--controller", "scripted", "--set", "controller.settings.script='rest'"]
    start = [sys.executable, "-c", "from taichisoft.command_line import main; main()", *words]
    endless = ["--output", folder, "--duration", "100000"]
    first = subprocess.Popen([*start, *endless], stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + PATIENCE
    while not (folder / "recording.h5").exists():
        assert time.monotonic() < deadline and first.poll() is None
        time.sleep(0.05)
    code, _, complaint = command(*words, "--output", folder, "--duration", "1")
    assert (code, complaint.count("\n")) == (2, 1)
    assert f"--output {folder}: a run is going on there (process {first.pid} on " in complaint
    shutil.rmtree(folder.rename(tmp_path / "removed"))  # at once: what the run writes meanwhile is not in the way
    _, complaint = first.communicate(timeout=PATIENCE)
    assert first.returncode == 2
    assert complaint == (
        f"taichisoft: {folder / 'recording.h5'}: was removed or replaced while the run went on; its instants are lost\n"
    )
