"""`taichisoft doctor` says what is there, what is missing, and how to get it."""

import re
import sys

import pytest
import typer
from typer.testing import CliRunner

import taichisoft_outputs
from taichisoft.base.processes import ChildResult
from taichisoft_outputs import doctor_command, system_libraries
from taichisoft_outputs.system_libraries import SYSTEM_LIBRARIES, graphics, packages_for


@pytest.fixture
def doctor():
    application = typer.Typer()
    taichisoft_outputs.taichisoft_commands(application)
    return lambda *options: CliRunner().invoke(application, ["doctor", *options])


def test_where_the_tests_run_nothing_is_missing(doctor):
    answer = doctor("--time-limit", "300")
    assert answer.exit_code == 0, answer.output
    rows = dict(line.split(maxsplit=2)[1:] for line in answer.output.splitlines())
    modules = ["taichi", "gmsh", "h5py", "matplotlib", "open3d", "viser"]
    assert list(rows) == ["python", *modules, graphics(), "picture", "ffmpeg", "libraries"]
    assert rows["taichi"] == "1.7.4"
    assert re.match(r"1\.\d, \S", rows[graphics()]), "its version and whose it is"
    assert "ffmpeg" in rows["ffmpeg"], "the path of the program"


def test_what_is_missing_is_named_with_the_package_to_install(doctor, monkeypatch):
    def bare_machine(arguments, time_limit):
        if "gmsh" in arguments[-1]:
            return ChildResult("OSError: libGLU.so.1: cannot open shared object file")
        if arguments[-1] == "picture":
            return ChildResult("the process was ended by SIGSEGV")
        if arguments[-1] == "video":
            return ChildResult("no ffmpeg, which writes videos: pip install imageio-ffmpeg")
        return ChildResult("", "1.0\n")

    monkeypatch.setattr(doctor_command, "run_python", bare_machine)
    answer = doctor()
    assert answer.exit_code == 1
    missing = [line.split()[1] for line in answer.output.splitlines() if line.startswith("MISSING")]
    assert missing == ["gmsh", "picture", "ffmpeg"]
    assert "MISSING ffmpeg      no ffmpeg, which writes videos: pip install imageio-ffmpeg\n" in answer.output
    install = answer.output.splitlines()[-1]
    assert "apt-get install" in install
    driver = {"EGL": {"libgl1-mesa-dri"}, "Vulkan": {"libvulkan1", "mesa-vulkan-drivers"}}
    drawing = {"libegl1", "libgl1"} | driver[graphics()]
    assert drawing | {"libglu1-mesa"} <= set(install.split())
    assert "libxft2" not in install, "gmsh said exactly what it misses"


def test_what_is_optional_is_no_fault(doctor, monkeypatch):
    def without(arguments, time_limit):
        absent = [module for module in ("gmsh", "viser") if f"import {module}" in arguments[-1]]
        return ChildResult(f"ModuleNotFoundError: No module named '{absent[0]}'" if absent else "", "1.0\n")

    monkeypatch.setattr(doctor_command, "run_python", without)
    answer = doctor()
    assert answer.exit_code == 0
    for line in (
        "without gmsh        not installed; meshing needs it: pip install taichisoft\n",
        "without viser       not installed; `taichisoft run --web` needs it: pip install 'taichisoft[web]'\n",
    ):
        assert line in answer.output
    assert "apt-get" not in answer.output, "no library of the system would help"


@pytest.mark.skipif(sys.platform != "linux", reason="EGL and Vulkan are how Linux draws without a display")
def test_a_driver_that_cannot_be_used_is_reported(monkeypatch):
    if graphics() == "EGL":
        monkeypatch.setenv("EGL_PLATFORM", "device")
        monkeypatch.setenv("__EGL_VENDOR_LIBRARY_FILENAMES", "/nowhere")
        problem, packages = "no driver for EGL_PLATFORM=device", {"libegl1", "libgl1-mesa-dri"}
    else:
        monkeypatch.setenv("VK_ICD_FILENAMES", "/nowhere")
        monkeypatch.setenv("VK_DRIVER_FILES", "/nowhere")
        problem, packages = "no driver for Vulkan", {"libvulkan1", "mesa-vulkan-drivers"}
    finding = doctor_command._examine(graphics())
    assert not finding.ok
    assert finding.found == problem
    assert packages <= set(finding.packages)


@pytest.mark.parametrize(
    ("installed", "expected"), [("0.19.0", "EGL"), ("0.20.0", "Vulkan"), ("1.0.1+x", "Vulkan"), (None, "Vulkan")]
)
def test_open3d_draws_with_vulkan_from_its_version_0_20(monkeypatch, installed, expected):
    def version(_distribution):
        if installed is None:
            raise system_libraries.PackageNotFoundError
        return installed

    monkeypatch.setattr(system_libraries, "version", version)
    assert graphics() == expected


def test_an_ffmpeg_that_does_not_start_is_reported(monkeypatch):
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", "/nowhere/ffmpeg")
    finding = doctor_command._examine("ffmpeg")
    assert not finding.ok
    assert finding.found == "/nowhere/ffmpeg: ffmpeg cannot be started: No such file or directory"


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


def test_a_check_that_hangs_does_not_keep_the_answer_waiting(doctor, monkeypatch):
    """Each is given the time that is left; those that have none are reported like those that took too long."""
    hanging = (("-c", "import time; time.sleep(600)"), "")
    monkeypatch.setattr(doctor_command, "PROGRAMS", dict.fromkeys("abcdef", hanging))
    answer = doctor("--time-limit", "1")
    assert answer.exit_code == 1
    rows = [line for line in answer.output.splitlines() if line.startswith("late")]
    assert [row.split()[1] for row in rows][:6] == list("abcdef")
    assert "apt-get" not in answer.output
