"""SOFA's Python scenes without SOFA: what they build, and what becomes of it."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taichisoft.plugin_system.hookspecs import hookimpl

if TYPE_CHECKING:
    import typer

    from taichisoft.plugin_system.hookspecs import RunOption


@hookimpl
def taichisoft_scene_readers() -> Mapping[str, Callable[..., Mapping[str, Any]]]:
    """SOFA's scenes of both generations."""
    return {".py": _read, ".pyscn": _read}


@hookimpl
def taichisoft_controllers() -> Mapping[str, Callable[..., Any]]:
    """The controller that lets a scene's own controllers steer."""
    from taichisoft_sofa.controller.controller import SofaController

    return {"sofa": SofaController}


@hookimpl
def taichisoft_run_options() -> "Mapping[str, RunOption]":
    """Options of `taichisoft run` about SOFA's scenes."""
    from taichisoft.plugin_system.hookspecs import RunOption

    return {
        "--python-path": RunOption(
            None, "Folders of libraries that a SOFA scene imports, as in PYTHONPATH.", "python_path", str, "DIRS"
        ),
        "--sofa-exact": RunOption(None, "Keep SOFA's reading where the usual one departs from it.", "sofa_exact", bool),
    }


@hookimpl
def taichisoft_commands(application: "typer.Typer") -> None:
    """`taichisoft sofa check` and `taichisoft sofa convert`."""
    from taichisoft_sofa.command import sofa

    application.add_typer(sofa, name="sofa")


def _read(path: Path, python_path: str = "", sofa_exact: bool = False) -> Mapping[str, Any]:
    from taichisoft_sofa.reader import read_scene  # the tree and the translation need not be there for other commands

    return read_scene(path, python_path, sofa_exact)
