"""Where the command is used as it was not developed: without a home, by a user without rights, from another folder.

A user without rights is made by setpriv where the tests run as root; it may read everything, since Python may be
installed in a folder of root's, and write nowhere but in its own folder.
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import PATIENCE

from taichisoft.base.files import cache_folder, temporary_cache

ROOT = Path(__file__).resolve().parents[1]
NOBODY = 65534
SCENE = """
[controller]
name = "scripted"
settings.script = "rest"
[rigid_bodies.cube]
box = [10.0, 10.0, 10.0]
mass = 0.001
"""

Run = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """Runs a short scene in a folder of its own, with these environment variables alone, as a user without rights."""
    prefix = []
    if os.getuid() == 0:
        if shutil.which("setpriv") is None:
            pytest.skip("needs setpriv, to be another user than root")
        rights = ("--inh-caps", "+dac_read_search", "--ambient-caps", "+dac_read_search")
        prefix = ["setpriv", "--reuid", str(NOBODY), "--regid", str(NOBODY), "--clear-groups", *rights]
    (tmp_path / "cube.toml").write_text(SCENE)
    (tmp_path / "temporary").mkdir()
    if prefix:
        for folder in (tmp_path, tmp_path / "temporary"):
            os.chown(folder, NOBODY, NOBODY)

    def started(**environment: str) -> "subprocess.CompletedProcess[str]":
        main = "from taichisoft.command_line import main; main()"
        command = [sys.executable, "-c", main, "run", "cube.toml", "--duration", "0.02"]
        kept = {name: os.environ[name] for name in ("PATH", "PYTHONPATH") if name in os.environ}
        usual = {"TMPDIR": str(tmp_path / "temporary"), "PYTHONDONTWRITEBYTECODE": "1"}
        return subprocess.run(
            [*prefix, *command],
            cwd=tmp_path,
            env=kept | usual | environment,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
        )

    return started


@pytest.mark.skipif(sys.platform != "linux", reason="homes are looked for otherwise on other systems")
def test_kernels_are_kept_without_home(run: Run, tmp_path: Path) -> None:
    """As in jobs of cron and in containers: Taichi used to end the process, or to crash at its end."""
    first = run()
    assert first.returncode == 0, first.stderr
    (cache,) = (tmp_path / "temporary").glob("taichisoft-cache-*")
    assert list(cache.rglob("*.kernel"))
    assert (tmp_path / "out" / "cube" / "recording.h5").is_file()
    assert "compiles its kernels" in first.stderr and "compiles its kernels" not in run().stderr


@pytest.mark.skipif(sys.platform != "linux", reason="homes are looked for otherwise on other systems")
def test_a_home_that_cannot_be_written_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path / "file" / "home"))
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    assert cache_folder() == tmp_path / f"taichisoft-cache-{os.getuid()}" / "taichisoft"
    (line,) = capsys.readouterr().err.splitlines()
    assert "cannot be written" in line and "XDG_CACHE_HOME can name another folder" in line
    cache_folder()
    assert capsys.readouterr().err == "", "told once: child processes and libraries use the same folder"


def test_folder_that_others_could_have_made_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Kernels in it are executed."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    usual = tmp_path / f"taichisoft-cache-{os.getuid()}"
    usual.mkdir(mode=0o700)
    assert temporary_cache() == usual
    usual.chmod(0o777)
    assert temporary_cache() != usual
    usual.rmdir()
    usual.symlink_to(tmp_path)
    assert temporary_cache() != usual
