"""What `taichisoft run` does: scene, controller, outputs, progress bar, closing table."""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from taichisoft import plugins
from taichisoft.errors import SceneError, TaichisoftError
from taichisoft.output import Output
from taichisoft.run import INTERRUPTED, count_steps, run
from taichisoft.scene import Scene
from taichisoft.scene_file import load_scene, scene_to_toml
from taichisoft.simulation import Simulation, StepReport


def run_scene(
    name: str,
    controller_name: str | None,
    folder: Path | None,
    overrides: Sequence[str],
    duration: float | None,
    output_names: Sequence[str],
) -> bool:
    """Run a scene into a folder; returns whether it was interrupted.

    Raises:
        TaichisoftError: anything that is the user's to mend.
    """
    console = Console()
    warnings.showwarning = lambda message, *_, **__: console.print(f"[yellow]warning:[/yellow] {message}")
    scene = load_scene(name, overrides)
    controller = make_controller(scene, controller_name)
    folder = folder if folder is not None else Path("out") / Path(name).stem
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "scene.toml").write_text(scene_to_toml(scene), encoding="utf-8")
    except OSError as error:
        raise TaichisoftError(f"--output {folder}: cannot be written: {error.strerror or error}") from error
    outputs = [plugins.make("taichisoft_outputs", "output", output, folder) for output in output_names]
    with console.status("preparing the model; the first time on a machine Taichi compiles its kernels"):
        simulation = Simulation(scene)
    seconds = duration if duration is not None else scene.time.duration
    outcome = "failed"
    try:
        with _progress(console) as progress:
            task = progress.add_task(scene.title or name, total=count_steps(seconds, scene.time.step), state="")

            def show(report: StepReport) -> None:
                state = f"{report.time:.2f} s  {report.contact_count} contacts"
                progress.update(task, advance=1, state=state)

            outcome = run(simulation, controller, outputs, duration, show)
    finally:
        _print_summary(console, outputs, folder)
    return outcome == INTERRUPTED


def make_controller(scene: Scene, name: str | None) -> Any:
    """The controller called `name`, or the scene's own, with the scene's settings if they are meant for it.

    Raises:
        SceneError: there is none, or its settings are wrong.
        PluginError: no plug-in provides it.
    """
    own = scene.controller
    if name is None and own is None:
        raise SceneError("the scene has no [controller]; name one with --controller")
    chosen = name if name is not None else own.name  # type: ignore[union-attr]
    settings = own.settings if own is not None and own.name == chosen else {}
    try:
        return plugins.make("taichisoft_controllers", "controller", chosen, **settings)
    except TypeError as error:
        raise SceneError(f"controller.settings: not valid for the controller '{chosen}': {error}") from error


def _progress(console: Console) -> Progress:
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.fields[state]}"),
        TimeRemainingColumn(),
        console=console,
    )


def _print_summary(console: Console, outputs: Sequence[Output], folder: Path) -> None:
    table = Table(show_header=False)
    for output in outputs:
        for quantity, value in getattr(output, "summary", dict)().items():
            table.add_row(quantity, value)
    if table.row_count:
        console.print(table)
    console.print(f"results in {folder}")
