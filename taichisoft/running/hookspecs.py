"""The hooks that a plug-in may implement, all of them; the built-in features use the same ones."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pluggy

if TYPE_CHECKING:
    import typer

    from taichisoft.control.control import Controller
    from taichisoft.mesh.volume_mesh import VolumeMesh
    from taichisoft.running.plugin_interfaces import Geometry, Renderer
    from taichisoft.running.session import Output, Session
    from taichisoft.step.solution import StepReport

PROJECT = "taichisoft"
hookspec = pluggy.HookspecMarker(PROJECT)
hookimpl = pluggy.HookimplMarker(PROJECT)
"""Decorator that marks a function of a plug-in, or a method of an object, as its implementation of a hook.

The function has the name of the hook. With `optionalhook=True` a hook that this version of taichisoft does not have is
no error; `tryfirst=True` and `trylast=True` change the order in which plug-ins are called.
"""


@dataclass(frozen=True)
class RunOption:
    """An option of `taichisoft run` that a plug-in adds: it brings an output into the run, or sets something of one.

    Without an output it sets something of the reader of the scene.

    Attributes:
        output: name of the output that takes part in the run when the option is given; None for one of scene readers.
        help: one line for `taichisoft run --help`.
        setting: argument of that output's factory, or of the scene reader, which gets the value; without one the option
            is a flag that brings the output.
        type: type of the value: str, int, float, bool (for a flag that is a setting) or pathlib.Path.
        metavar: name of the value in the help.
        controller: name of the controller if the command line names none and the scene's own ignores keys; None for
            the scene's own in any case.
    """

    output: str | None
    help: str
    setting: str | None = None
    type: type = str
    metavar: str | None = None
    controller: str | None = None


@hookspec
def taichisoft_controllers() -> "Mapping[str, Callable[..., Controller]]":  # type: ignore[empty-body]
    """Controllers by name; called when a run looks for its controller.

    Each value makes a controller. Its arguments are the keys that `controller.settings` of a scene may have; those
    without a default must be there. Where its only argument is annotated with a dataclass or a pydantic model, the keys
    are the fields of that. Values of another type than the annotated one are refused before the run.
    """


@hookspec
def taichisoft_outputs() -> "Mapping[str, Callable[..., Output]]":  # type: ignore[empty-body]
    """Outputs by name; called when a run looks for its outputs.

    Each value makes an output from the folder into which it may write; its other arguments, with defaults, are what
    `taichisoft_run_options` may set.
    """


@hookspec
def taichisoft_run_options() -> "Mapping[str, RunOption]":  # type: ignore[empty-body]
    """Options of `taichisoft run` by name ("--web"); called when the command line is read.

    Each value is a `taichisoft.RunOption`: which output takes part in the run when the option is given, and which
    argument of its factory, or of the scene's reader, gets the value.
    """


@hookspec
def taichisoft_geometry_kinds() -> "Mapping[str, Callable[[Mapping[str, Any], Path], Geometry]]":  # type: ignore[empty-body]
    """Kinds of bodies that `taichisoft mesh` can mesh; called when it has read a file, whose `kind` names one.

    Each value makes a geometry from the file's tables without `kind`, and from the file's path: it begins every error,
    and files that the tables name are looked for beside it.
    """


@hookspec
def taichisoft_mesh_makers() -> "Mapping[str, Callable[..., VolumeMesh]]":  # type: ignore[empty-body]
    """Makers of meshes for scenes, by the suffix (".toml") of files that are not meshes; called when a model needs one.

    Each value makes a mesh of the file whose path it is given first. Its other arguments are the keys that
    `soft_bodies.NAME.mesh` of a scene may have beside `file`. What it logs to a logger below "taichisoft" is shown by
    `taichisoft run`.
    """


@hookspec
def taichisoft_scene_readers() -> "Mapping[str, Callable[..., Mapping[str, Any]]]":  # type: ignore[empty-body]
    """Readers of scenes in other formats than TOML, by suffix (".yaml"); called when a scene is not a TOML file.

    Each value reads a file, whose path it is given first, into the tables that the same scene would have in TOML.
    Overrides, inheritance, file names and checks come after it. Its other arguments, with defaults, are what
    `taichisoft_run_options` without an output may set, and the `reader_settings` of `load_scene`. What it logs to a
    logger below "taichisoft" is shown by `taichisoft run`.
    """


@hookspec
def taichisoft_renderers() -> "Mapping[str, Callable[..., Renderer]]":  # type: ignore[empty-body]
    """Renderers by name; called when a simulation is to draw its first picture.

    Each value makes a renderer of the arguments `model`, `size` and `camera`, as `Simulation.render` describes them.
    """


@hookspec
def taichisoft_materials() -> "Mapping[str, Mapping[str, Any]]":  # type: ignore[empty-body]
    """Materials by the name that `material` of a scene gives; called when a scene that names one is read.

    Each value has the keys of a material's file: name, law, coefficients, poisson_ratio, density, highest_stretch,
    source. A name of theirs wins over one that ships.
    """


@hookspec
def taichisoft_scene_additions() -> "Mapping[str, Callable[[Mapping[str, Any], Path], Mapping[str, Any]]]":  # type: ignore[empty-body]
    """What controllers add to scenes, by the controller's name; called when a scene that names a controller is read.

    Each value gives tables by the keys of a scene (`rigid_bodies`, `frames`), from the controller's settings and the
    folder in which files are looked for first. Entries of the scene with the same name stay unchanged.
    """


@hookspec
def taichisoft_commands(application: "typer.Typer") -> None:
    """Add sub-commands to the command line; called once when `taichisoft` starts, also for `--help`.

    Args:
        application: an empty one, whose commands and groups are added to `taichisoft`. A group of the same name that
            another plug-in adds has the commands of both.
    """


@hookspec
def taichisoft_run_begins(session: "Session") -> None:
    """A run is about to make its first step: the controller has been reset, and the outputs have begun.

    Args:
        session: the run in progress.
    """


@hookspec
def taichisoft_step_done(session: "Session", report: "StepReport") -> None:
    """A step is done, and every output has recorded it. Costs nothing where no plug-in implements it.

    Args:
        session: the run in progress.
        report: what happened in the step.
    """


@hookspec
def taichisoft_run_ends(session: "Session", outcome: str) -> None:
    """A run has ended, however it did, and so have its outputs.

    Args:
        session: the run, at its last good state.
        outcome: "completed", "stopped" by its user, "interrupted", or the text of the error.
    """


@hookspec
def taichisoft_picture_wanted(session: "Session") -> None:
    """A picture of the present state is requested; called between two steps, also while the run is paused.

    Args:
        session: the run in progress.
    """
