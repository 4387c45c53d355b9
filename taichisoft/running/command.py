"""What `taichisoft run` does: scene, controller, outputs, session, and what is shown of them."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rich
import typer
from rich.console import Console

from taichisoft.atomic_file import named_os_errors
from taichisoft.building.run_parts import make_controller, make_output
from taichisoft.building.scene_files import load_scene
from taichisoft.building.simulation import Simulation
from taichisoft.errors import SceneError, TaichisoftError
from taichisoft.running.display import print_profile, print_summary, progress_bar, warn_if_slow
from taichisoft.running.folder_lock import locked_folder
from taichisoft.running.live_status import live_status
from taichisoft.running.loop import INTERRUPTED, run_session
from taichisoft.running.messages import logged_to, warnings_printed_to
from taichisoft.running.profile import Profile, profiled
from taichisoft.scenes.file import scene_to_toml
from taichisoft.scenes.scene import Scene
from taichisoft.session.key_log import KeyReplay
from taichisoft.session.session import Session
from taichisoft.step.report import StepReport

EXIT_FAILED = 1
EXIT_INTERRUPTED = 130


@dataclass(frozen=True)
class RunRequest:
    """Everything that the command line asks of a run, beside its scene.

    Attributes:
        folder: folder for the results.
        outputs: settings of each output by its name.
        duration: simulated time [s]; None for the usual one.
        speed: simulated over wall-clock time; None for the usual one.
        replay: keys of an earlier run; None where keys come from the user.
        profile: whether to show where the time of a step goes.
        steering: name of the controller for an output with which a user steers, such as a page; None without one.
    """

    folder: Path
    outputs: Mapping[str, Mapping[str, Any]]
    duration: float | None = None
    speed: float | None = None
    replay: KeyReplay | None = None
    profile: bool = False
    steering: str | None = None


def run_scene(
    name: str,
    overrides: Sequence[str],
    controller: str | None,
    request: RunRequest,
    reader_settings: Mapping[str, Any] | None = None,
    goal: str | None = None,
) -> None:
    """Run a scene by path or by the name of a shipped one; `load_scene` describes all but `request`.

    Where the user steers and names no controller, the scene's own goes on if it heeds keys.

    Raises:
        TaichisoftError: anything that is the user's to mend.
        typer.Exit: the run was interrupted.
    """
    with warnings_printed_to(rich.get_console()), logged_to(rich.get_console()):
        scene = load_scene(name, overrides, controller, reader_settings, goal)
        if request.steering is not None and controller is None and not _heeds_keys(scene):
            scene = load_scene(name, overrides, request.steering, reader_settings, goal)
    run_simulation(name, scene, lambda: Simulation(scene), request)


def run_simulation(
    name: str,
    scene: Scene,
    make_simulation: Callable[[], Simulation],
    request: RunRequest,
    usual_duration: Callable[[], float] | None = None,
) -> None:
    """Run what `make_simulation` gives, from its present state, into a folder.

    Args:
        name: text that begins errors of the scene and of what is made from it.
        scene: names the controller.
        make_simulation: called when everything that is cheap to check has been checked.
        request: folder, outputs, duration and so on.
        usual_duration: gives the duration of a run for which the user names none and which nobody steers [s]; the
            scene's when it is not given.

    Raises:
        TaichisoftError: anything that is the user's to mend.
        typer.Exit: the run was interrupted.
    """
    duration, speed, folder = request.duration, request.speed, request.folder
    if speed is not None and not 0.0 < speed < math.inf:
        raise TaichisoftError(f"--speed {speed:g}: must be a positive, finite number; 1 is real time")
    console = rich.get_console()  # an output that takes long at the end shows its progress there too
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
        # Before the model is prepared, which takes long: a misspelt name or a wrong setting is said at once.
        outputs = [make_output(output, folder, **settings) for output, settings in request.outputs.items()]
        status = "preparing the model; the first time on a machine Taichi compiles its kernels"
        with console.status(status), logged_to(console), _errors_in(name):
            simulation = make_simulation()
        if speed is not None:
            with console.status(status):
                _load_kernels(simulation)
        session = Session(simulation, controller, outputs, duration, folder, speed, request.replay)
        _write_scene(scene, folder)
        outcome = _run(session, console, folder, scene.title or name, request.profile)
    if outcome == INTERRUPTED:
        raise typer.Exit(EXIT_INTERRUPTED)


def _heeds_keys(scene: Scene) -> bool:
    return scene.controller is not None and bool(make_controller(scene).bindings)


def _run(session: Session, console: Console, folder: Path, title: str, profile: bool) -> str:
    """Run with a display; whatever happens, what the outputs have to say is shown."""
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
    """The display of a run, called after every step: state and keys where somebody steers, else how far the run is."""
    if session.controller.interactive and not session.replaying:
        return live_status(console, session)
    return progress_bar(console, session, title)


def _load_kernels(simulation: Simulation) -> None:
    """Make a step and take it back: the first one takes seconds, in which a run at a speed would fall behind."""
    state = simulation.state
    with suppress(TaichisoftError):  # the run itself will say so, with its outputs
        simulation.step()
    simulation.restore(state)


@contextmanager
def _errors_in(scene: str) -> Iterator[None]:
    """Begin the errors of what is made from a scene with its name."""
    try:
        yield
    except SceneError as error:
        raise SceneError(f"{scene}: {error}") from error


def _write_scene(scene: Scene, folder: Path) -> None:
    with named_os_errors(f"--output {folder}"):
        (folder / "scene.toml").write_text(scene_to_toml(scene), encoding="utf-8")
