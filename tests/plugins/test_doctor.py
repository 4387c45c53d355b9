"""`taichisoft doctor` says what is there, what is missing, and how to get it."""

import pytest
import typer
from typer.testing import CliRunner

import taichisoft_plugins
from taichisoft_plugins import doctor_command
from taichisoft_plugins.child_process import ChildResult
from taichisoft_plugins.system_libraries import SYSTEM_LIBRARIES, packages_for


@pytest.fixture
def doctor():
    application = typer.Typer()
    taichisoft_plugins.taichisoft_commands(application)
    return lambda: CliRunner().invoke(application, ["doctor"])


def test_where_the_tests_run_nothing_is_missing(doctor):
    answer = doctor()
    assert answer.exit_code == 0, answer.output
    subjects = [line.split()[1] for line in answer.output.splitlines()]
    assert subjects == ["python", "taichi", "gmsh", "h5py", "open3d", "picture", "libraries"]
    assert "1.7.4" in answer.output


def test_what_is_missing_is_named_with_the_package_to_install(doctor, monkeypatch):
    def bare_machine(arguments, time_limit):
        if "gmsh" in arguments[-1]:
            return ChildResult("OSError: libGLU.so.1: cannot open shared object file")
        if "picture_check" in arguments[-1]:
            return ChildResult("the process was ended by SIGSEGV")
        return ChildResult("", "1.0\n")

    monkeypatch.setattr(doctor_command, "run_python", bare_machine)
    answer = doctor()
    assert answer.exit_code == 1
    missing = [line.split()[1] for line in answer.output.splitlines() if line.startswith("MISSING")]
    assert missing == ["gmsh", "picture"]
    install = answer.output.splitlines()[-1]
    assert "apt-get install" in install
    drawing = {"libegl1", "libgl1", "libgl1-mesa-dri", "libgomp1"}
    assert drawing | {"libglu1-mesa"} <= set(install.split())
    assert "libxft2" not in install, "gmsh said exactly what it misses"


def test_all_missing_libraries_are_found_at_once(monkeypatch):
    missing = {"libXft.so.2", "libudev.so.1"}
    monkeypatch.setattr(
        doctor_command,
        "run_python",
        lambda arguments, _: ChildResult("OSError" if any(f in arguments[-1] for f in missing) else ""),
    )
    monkeypatch.setattr(doctor_command.sys, "platform", "linux")
    finding = doctor_command._examine_libraries()
    assert not finding.ok
    assert set(finding.packages) == {"libxft2", "libudev1"}


def test_a_library_leads_to_its_package():
    for library in SYSTEM_LIBRARIES:
        if library.file:
            message = f"ImportError: {library.file}: cannot open shared object file: No such file or directory"
            assert packages_for(message, "taichi") == [library.package]
    assert packages_for("libunknown.so.3: cannot open shared object file", "h5py") == []
