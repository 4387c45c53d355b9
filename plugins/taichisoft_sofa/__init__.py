"""SOFA's Python scenes without SOFA: execution, translation and control."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taichisoft.running import Imported, hookimpl

if TYPE_CHECKING:
    import typer

    from taichisoft.running import RunOption


@hookimpl
def taichisoft_scene_readers() -> Mapping[str, Callable[..., Mapping[str, Any]]]:
    """Readers of SOFA's scenes of both generations, and in XML."""
    return {".py": _read, ".pyscn": _read, ".scn": _read}


@hookimpl
def taichisoft_controllers() -> Mapping[str, Callable[..., Any]]:
    """The controller that runs a scene's own controllers."""
    return Imported(__name__, {"sofa": "controller.sofa_controller:SofaController"})


@hookimpl
def taichisoft_run_options() -> "Mapping[str, RunOption]":
    """Options of `taichisoft run` about SOFA's scenes."""
    from taichisoft.running import RunOption

    return {
        "--python-path": RunOption(
            None, "Folders of libraries that a SOFA scene imports, as in PYTHONPATH.", "python_path", str, "DIRS"
        ),
        "--data-path": RunOption(
            None, "Folders of meshes that a SOFA scene names, such as SOFA's share.", "data_path", str, "DIRS"
        ),
        "--sofa-exact": RunOption(None, "Follow SOFA exactly where the default departs from it.", "sofa_exact", bool),
    }


@hookimpl
def taichisoft_commands(application: "typer.Typer") -> None:
    """`taichisoft sofa check` and `taichisoft sofa convert`."""
    from taichisoft_sofa.sofa_commands import sofa

    application.add_typer(sofa, name="sofa")


def _read(path: Path, python_path: str = "", sofa_exact: bool = False, data_path: str = "") -> Mapping[str, Any]:
    from taichisoft_sofa.scene_reader import read_scene  # other commands need neither tree nor translation

    return read_scene(path, python_path, sofa_exact, data_path)
