"""The command `taichisoft run`: scene, controller, outputs, session, and their display."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import rich
import typer
from rich.console import Console

from taichisoft.atomic_file import named_os_errors
from taichisoft.building.reduced_scene import with_reduced_bodies
from taichisoft.building.run_parts import make_controller, make_output
from taichisoft.building.scene_files import load_scene
from taichisoft.building.simulation import Simulation
from taichisoft.control.controller import Controller
from taichisoft.errors import SceneError, TaichisoftError
from taichisoft.running.display import print_profile, print_summary, progress_bar, warn_if_slow
from taichisoft.running.folder_lock import locked_folder
from taichisoft.running.live_status import live_status
from taichisoft.running.loop import INTERRUPTED, run_session
from taichisoft.running.messages import logged_to, warnings_printed_to
from taichisoft.running.profile import Profile, profiled
from taichisoft.runtime.launch import compilations_shown
from taichisoft.scenes.file import scene_to_toml
from taichisoft.scenes.scene import Scene
from taichisoft.session.key_log import KeyReplay
from taichisoft.session.session import Session
from taichisoft.step.report import StepReport

EXIT_FAILED = 1
EXIT_INTERRUPTED = 130


@dataclass(frozen=True)
class RunRequest:
    """Options of a run on the command line, beside the scene.

    Attributes:
        folder: folder for the results.
        outputs: settings of each output by its name.
        duration: simulated time [s]; None: the default.
        speed: simulated over wall-clock time [-]; None: the default.
        replay: keys of an earlier run; None: keys from the user.
        profile: whether to show the times of the phases of a step.
        saved: what the controller goes on from, as its `save` gave it; None: it begins with `reset` alone.
        steering: name of the controller for an output by which a user steers, such as a page, or None.
        reduced: folder with the modes of soft bodies, or None.
        steps: number of time steps, instead of `duration`, or None.
    """

    folder: Path
    outputs: Mapping[str, Mapping[str, Any]]
    duration: float | None = None
    speed: float | None = None
    replay: KeyReplay | None = None
    profile: bool = False
    steering: str | None = None
    reduced: Path | None = None
    steps: int | None = None
    saved: Mapping[str, Any] | None = None


def run_scene(
    name: str,
    overrides: Sequence[str],
    controller: str | None,
    request: RunRequest,
    reader_settings: Mapping[str, Any] | None = None,
    goal: str | None = None,
) -> None:
    """Run a scene by path or by the name of a shipped scene; `load_scene` describes all arguments but `request`.

    If the user steers and names no controller, the scene's own is kept if it responds to keys.

    Raises:
        TaichisoftError: an error that the user can correct.
        typer.Exit: the run was interrupted.
    """
    with warnings_printed_to(rich.get_console()), logged_to(rich.get_console()):
        scene = load_scene(name, overrides, controller, reader_settings, goal)
        if request.steering is not None and controller is None and not _responds_to_keys(scene):
            scene = load_scene(name, overrides, request.steering, reader_settings, goal)
        if request.reduced is not None:
            scene = with_reduced_bodies(scene, request.reduced)
    run_simulation(name, scene, lambda: Simulation(scene), request)


def run_simulation(
    name: str,
    scene: Scene,
    make_simulation: Callable[[], Simulation],
    request: RunRequest,
    usual_duration: Callable[[], float] | None = None,
) -> None:
    """Run a simulation from its present state, with results in a folder.

    Args:
        name: text with which errors of the scene and its parts begin.
        scene: scene with the controller.
        make_simulation: makes the simulation; called after all cheap checks.
        request: folder, outputs, duration and so on.
        usual_duration: returns the duration of a run that is not steered and for which the user names none [s]; None:
            the scene's.

    Raises:
        TaichisoftError: an error that the user can correct.
        typer.Exit: the run was interrupted.
    """
    duration, speed, folder = request.duration, request.speed, request.folder
    if request.steps is not None:
        if duration is not None:
            raise TaichisoftError(f"--steps {request.steps}, --duration {duration:g}: give one of them")
        duration = request.steps * scene.time.step
    if speed is not None and not 0.0 < speed < math.inf:
        raise TaichisoftError(f"--speed {speed:g}: must be a positive, finite number; 1 is real time")
    console = rich.get_console()  # an output that takes long at the end also shows its progress there
    with warnings_printed_to(console), locked_folder(folder):
        with _errors_in(name):
            controller = make_controller(scene)
        if request.steering is not None and controller.bindings:
            controller.interactive = True
        if controller.interactive and request.replay is None:
            duration = math.inf if duration is None else duration
            speed = 1.0 if speed is None else speed
        if duration is None and usual_duration is not None:
            duration = usual_duration()
        # Before the model, which takes long to prepare, so that a misspelt name or a wrong setting is reported at once.
        outputs = [make_output(output, folder, **settings) for output, settings in request.outputs.items()]
        status = "preparing the model"
        with console.status(status), logged_to(console), _errors_in(name):
            simulation = make_simulation()
        if speed is not None:
            with console.status(status) as shown, compilations_shown(lambda one: shown.update(f"preparing {one}")):
                _load_kernels(simulation)
        session = Session(
            simulation,
            controller,
            outputs,
            duration,
            folder,
            speed,
            request.replay,
            request.saved,
            partial(_controller_with, scene),
        )
        _write_scene(scene, folder)
        outcome = _run(session, console, folder, scene.title or name, request.profile)
    if outcome == INTERRUPTED:
        raise typer.Exit(EXIT_INTERRUPTED)


def _controller_with(scene: Scene, settings: Mapping[str, Any]) -> Controller:
    """The scene's controller with some other settings."""
    assert scene.controller is not None
    changed = scene.controller.model_copy(update={"settings": {**scene.controller.settings, **settings}})
    return make_controller(scene.model_copy(update={"controller": changed}))


def _responds_to_keys(scene: Scene) -> bool:
    return scene.controller is not None and bool(make_controller(scene).bindings)


def _run(session: Session, console: Console, folder: Path, title: str, profile: bool) -> str:
    """Run with a display; the summaries of the outputs are shown however the run ends."""
    times: Profile | None = None
    measured: AbstractContextManager[Profile | None] = profiled(session.simulation) if profile else nullcontext()
    try:
        with _display(session, console, title) as show, measured as times:
            outcome = run_session(session, show)
    finally:
        complete = print_summary(console, [session.controller, *session.outputs], folder)
        warn_if_slow(console, session)
        if times is not None and times.seconds:
            print_profile(console, times)
    if not complete:
        raise typer.Exit(EXIT_FAILED)
    return outcome


def _display(session: Session, console: Console, title: str) -> AbstractContextManager[Callable[[StepReport], None]]:
    """Display of a run, called after every step: state and keys of an interactive run, else a progress bar."""
    if session.controller.interactive and not session.replaying:
        return live_status(console, session)
    return progress_bar(console, session, title)


def _load_kernels(simulation: Simulation) -> None:
    """Make a step and undo it: the first step takes seconds, by which a run at a set speed would fall behind."""
    state = simulation.state
    with suppress(TaichisoftError):  # the run itself reports the error, with its outputs
        simulation.step()
    simulation.restore(state)


@contextmanager
def _errors_in(scene: str) -> Iterator[None]:
    """Prefix errors of the parts made from a scene with the scene's name."""
    try:
        yield
    except SceneError as error:
        raise SceneError(f"{scene}: {error}") from error


def _write_scene(scene: Scene, folder: Path) -> None:
    with named_os_errors(f"--output {folder}"):
        (folder / "scene.toml").write_text(scene_to_toml(scene), encoding="utf-8")
