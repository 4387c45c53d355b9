"""What `taichisoft run` does: scene, controller, outputs, progress bar, closing table."""

import inspect
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from taichisoft import plugins
from taichisoft.errors import PluginError, SceneError, TaichisoftError
from taichisoft.output import Output
from taichisoft.profile import REST, TOTAL, Profile, profiled
from taichisoft.run import INTERRUPTED, count_steps, run
from taichisoft.scene import Scene
from taichisoft.scene_file import load_scene, scene_to_toml
from taichisoft.simulation import Simulation, StepReport
from taichisoft.validation_errors import nearest


def run_scene(
    name: str,
    controller_name: str | None,
    folder: Path | None,
    overrides: Sequence[str],
    duration: float | None,
    output_names: Sequence[str],
    profile: bool = False,
) -> bool:
    """Run a scene into a folder; returns whether it was interrupted. `profile` shows where the time of a step goes.

    Raises:
        TaichisoftError: anything that is the user's to mend.
    """
    console = Console()
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_, **__: _print_warning(console, str(message))
        scene = load_scene(name, overrides)
        step_count = count_steps(duration if duration is not None else scene.time.duration, scene.time.step)
        with _errors_in(name):
            controller = make_controller(scene, controller_name)
        output_factories = {output: plugins.find("output", output) for output in output_names}
        folder = folder if folder is not None else Path("out") / Path(name).stem
        status = "preparing the model; the first time on a machine Taichi compiles its kernels"
        with console.status(status), _errors_in(name):
            simulation = Simulation(scene)
        _write_scene(scene, folder)
        outputs = [_make(f"output '{output}'", make, folder) for output, make in output_factories.items()]
        times: Profile | None = None
        try:
            with _progress(console) as progress, profiled(simulation) if profile else nullcontext() as times:
                task = progress.add_task(scene.title or name, total=step_count, state="")

                def show(report: StepReport) -> None:
                    state = f"{report.time:.2f} s  {report.contact_count} contacts"
                    progress.update(task, advance=1, state=state)

                outcome = run(simulation, controller, outputs, duration, show)
        finally:
            _print_summary(console, outputs, folder)
            if times is not None and times.seconds:
                console.print(_profile_table(times))
        return outcome == INTERRUPTED


def make_controller(scene: Scene, name: str | None) -> Any:
    """The controller called `name`, or the scene's own, with the scene's settings if they are meant for it.

    Raises:
        SceneError: there is none, or its settings are wrong.
        PluginError: no plug-in provides it, or it cannot be made.
    """
    own = scene.controller
    chosen = name if name is not None else own.name if own is not None else None
    if chosen is None:
        raise SceneError("there is no [controller]; name one with --controller")
    settings = own.settings if own is not None and own.name == chosen else {}
    factory = plugins.find("controller", chosen)
    _check_settings(factory, settings)
    return _make(f"controller '{chosen}'", factory, **settings)


def _check_settings(factory: Callable[..., Any], settings: Mapping[str, Any]) -> None:
    """Compare the names of the settings with the arguments of what makes the controller."""
    arguments = inspect.signature(factory).parameters
    takes_any = any(argument.kind is argument.VAR_KEYWORD for argument in arguments.values())
    named = [a for a in arguments.values() if a.kind in (a.POSITIONAL_OR_KEYWORD, a.KEYWORD_ONLY)]
    valid = [argument.name for argument in named]
    for key in settings:
        if key not in valid and not takes_any:
            hint = nearest(key, valid, "valid keys")
            raise SceneError(f"controller.settings.{key}: unknown key; {hint}")
    for argument in named:
        if argument.default is argument.empty and argument.name not in settings:
            raise SceneError(f"controller.settings.{argument.name}: this key is missing")


def _make(what: str, factory: Callable[..., Any], *arguments: Any, **settings: Any) -> Any:
    try:
        return factory(*arguments, **settings)
    except TaichisoftError:
        raise
    except Exception as error:
        raise plugins.plugin_failure(f"{what} cannot be made", error) from error


@contextmanager
def _errors_in(scene: str) -> Iterator[None]:
    """Begin the errors of what is made from a scene with its name."""
    try:
        yield
    except SceneError as error:
        raise SceneError(f"{scene}: {error}") from error


def _write_scene(scene: Scene, folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "scene.toml").write_text(scene_to_toml(scene), encoding="utf-8")
    except OSError as error:
        raise TaichisoftError(f"--output {folder}: cannot be written: {error.strerror or error}") from error


def _progress(console: Console) -> Progress:
    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.fields[state]}"),
        TimeRemainingColumn(),
        console=console,
    )


def _print_warning(console: Console, message: str) -> None:
    console.print(Text.assemble(("warning: ", "yellow"), message), soft_wrap=True)


def _profile_table(profile: Profile) -> Table:
    """Phases of a step, in its order."""
    medians = profile.medians()
    whole = medians[TOTAL][0]
    table = Table("phase of a step", title=f"median times of {len(profile.seconds[TOTAL])} steps")
    for heading in ("[ms]", "share", "of it in Python [ms]"):
        table.add_column(Text(heading), justify="right")
    for phase, (time, in_python) in medians.items():
        table.add_row(phase, f"{time:.3f}", f"{time / whole:.0%}", f"{in_python:.3f}", end_section=phase == REST)
    return table


def _print_summary(console: Console, outputs: Sequence[Output], folder: Path) -> None:
    """The closing table; an output that cannot give its rows must not hide how the run ended."""
    table = Table(show_header=False)
    for output in outputs:
        try:
            for quantity, value in getattr(output, "summary", dict)().items():
                table.add_row(Text(quantity), Text(value))
        except Exception as error:
            failure: PluginError = plugins.plugin_failure(f"output {type(output).__name__} failed in summary()", error)
            _print_warning(console, str(failure))
    if table.row_count:
        console.print(table)
    console.print(Text(f"results in {folder}"), soft_wrap=True)
