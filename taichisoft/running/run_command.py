"""The command `taichisoft run`: scene, controller, outputs, session, and their display."""

import logging
import math
import os
import socket
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import rich
import typer
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
from rich.table import Table
from rich.text import Text

from taichisoft.base.files import named_os_errors
from taichisoft.base.text import plain, printable, warn_caller
from taichisoft.control.control import Controller
from taichisoft.errors import SceneError, TaichisoftError
from taichisoft.running.loop import INTERRUPTED, run_session
from taichisoft.running.plugins import plugin_failure
from taichisoft.running.profile import REST, TOTAL, Profile, profiled
from taichisoft.running.scene_files import load_scene, make_controller, make_output, with_reduced_bodies
from taichisoft.running.session import KEEPING_UP, KeyReplay, Output, Session
from taichisoft.running.simulation import Simulation
from taichisoft.runtime.launch import compilations_shown
from taichisoft.scene.file import scene_to_toml
from taichisoft.scene.scene import Scene
from taichisoft.step.solution import StepReport

# Warnings and log messages on a console, one line each; does not import Taichi.

PROJECT_LOGGER = "taichisoft"


def print_line(console: Console, line: str) -> None:
    """Print one line, without markup."""
    console.print(plain(line), soft_wrap=True)


def print_warning(console: Console, message: str) -> None:
    """Print a warning in one line, without markup."""
    console.print(Text.assemble(("warning: ", "yellow"), printable(message)), soft_wrap=True)


@contextmanager
def warnings_printed_to(console: Console) -> Iterator[None]:
    """Print Python's warnings by `print_warning` within the context."""
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_, **__: print_warning(console, str(message))
        yield


@contextmanager
def logged_to(console: Console) -> Iterator[None]:
    """Print messages of the logger "taichisoft" and its children, one line each, within the context."""
    logger, handler = logging.getLogger(PROJECT_LOGGER), _ConsoleHandler(console)
    level_before = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.setLevel(level_before)
        logger.removeHandler(handler)


class _ConsoleHandler(logging.Handler):
    def __init__(self, console: Console):
        super().__init__()
        self._console = console

    def emit(self, record: logging.LogRecord) -> None:
        print_line(self._console, record.getMessage())


# Status display of an interactive run: time, speed, pressures, object, last keys.

REFRESHES = 8
"""Redraws of the status per second of wall-clock time."""
SECONDS_BETWEEN_LINES = 5.0
"""Wall-clock time between two lines [s], on consoles that cannot redraw lines."""


@contextmanager
def live_status(console: Console, session: Session) -> Iterator[Callable[[StepReport], None]]:
    """Show a run on the console, redrawn in place or else as occasional lines; yields the function to call after steps.

    A separate thread redraws the status, so that a pause shows at once and steps are not delayed. The display ends
    silently when the terminal is closed, which must not stop the outputs of the run.
    """
    status = LiveStatus(console, session)
    if not console.is_terminal or console.is_dumb_terminal:
        yield status.update
        status.print_line()
        return
    live = Live(get_renderable=status.picture, console=console, refresh_per_second=REFRESHES)
    with suppress(OSError):
        live.start(refresh=True)
    try:
        yield status.update
    finally:
        with suppress(OSError):
            live.stop()


class LiveStatus:
    """Time, speed, pressures, object and keys of a run as text."""

    def __init__(self, console: Console, session: Session):
        self._console = console
        self._session = session
        self._last_line = time.monotonic()
        self._help_was_shown = False
        self._scene = session.simulation.model.scene
        self._object = self._scene.main_object

    def update(self, report: StepReport) -> None:
        """Note a step; on consoles without redrawing, print a line if the last line is old enough."""
        if self._console.is_terminal and not self._console.is_dumb_terminal:
            return
        if self._session.shows_help and not self._help_was_shown:
            self._console.print(self._help())
        self._help_was_shown = self._session.shows_help
        if time.monotonic() - self._last_line >= SECONDS_BETWEEN_LINES:
            self.print_line()

    def print_line(self) -> None:
        """Print the state of the run in one line."""
        self._last_line = time.monotonic()
        parts = [self._clock(), self._pressures()]
        if self._object is not None:
            parts.append(f"{self._object} {self._object_state()}")
        with suppress(OSError):
            print_line(self._console, "; ".join(parts))

    def picture(self) -> RenderableType:
        """The state of the run in a constant number of lines, and the help of the keys if requested."""
        rows = Table.grid(padding=(0, 2))
        rows.add_column(style="cyan", no_wrap=True)
        rows.add_column(no_wrap=True, overflow="ellipsis")
        rows.add_row("time", plain(self._clock()))
        rows.add_row("pressure", plain(self._pressures()))
        if self._object is not None:
            rows.add_row(plain(self._object), plain(self._object_state()))
        keys = " ".join(str(event) for event in tuple(self._session.recent_keys))
        rows.add_row("keys", plain(keys or "none yet"))
        hint = "? shows what the keys do, Esc ends the run"
        notes = filter(None, [self._session.controller.status, self._session.notice, hint])
        rows.add_row("", Text(printable("; ".join(notes)), style="dim"))
        return Group(rows, self._help()) if self._session.shows_help else rows

    def _clock(self) -> str:
        pace = self._session.pace
        text = f"{self._session.simulation.state.time:.2f} s"
        if self._session.paused:
            return f"{text}, paused"
        if np.isfinite(pace.real_time_factor):
            text += f" at {pace.real_time_factor:.2f} x real time"
        return text if pace.keeps_up else f"{text}, cannot keep up with {pace.speed:g} x"

    def _pressures(self) -> str:
        """Pressures; a single value if all agree to the shown digits."""
        pressures = self._session.simulation.observe().truth.pressures
        shown = {name: f"{value:.1f} kPa" for name, value in pressures.items()}
        if len(set(shown.values())) > 1:
            return ", ".join(f"{name} {value}" for name, value in shown.items())
        return next(iter(shown.values()), "none")

    def _object_state(self) -> str:
        """Lift against gravity since the first state, and the sum of the normal forces of soft bodies."""
        session, index = self._session, list(self._scene.rigid_bodies).index(self._object or "")
        displacement = session.simulation.state.rigid_position[index] - session.first_state.rigid_position[index]
        forces = session.simulation.observe().truth.normal_forces
        soft = self._scene.soft_bodies.keys()
        force = sum(forces[pair] for pair in forces if self._object in pair and not soft.isdisjoint(pair))
        return f"lifted by {self._scene.up @ displacement:z.1f} mm, pressed with {force:.0f} mN"

    def _help(self) -> RenderableType:
        table = Table("key", "what it does", title="keys, with Ctrl or without", title_justify="left")
        for key, effect in self._session.bindings.items():
            table.add_row(plain(key), plain(effect))
        return table


# How far something is: a bar in a terminal, a line every 5 s without one.


@contextmanager
def progress_bar(
    console: Console, title: str, total: float | None = None, unit: str = "", begun: int = 0
) -> Iterator[Callable[..., None]]:
    """Show how far something is, and the time that is left at its mean speed.

    Args:
        total: how much there is to do; None if it is not known, or nothing is counted.
        unit: what is counted, such as "pictures"; "%" to show the share that is done.
        begun: how much of it was done earlier.

    Yields:
        A function that counts one, or what is given as in `rich.progress.Progress.update` (`advance`, `completed`,
        `total`, and a text as `state`), and prints a line about it unless that is "".
    """
    drawn = console.is_jupyter or (console.is_terminal and not console.is_dumb_terminal)
    how_far, ended = _HowFar(), threading.Event()
    columns = TextColumn("{task.description}", markup=False), BarColumn(), how_far
    with Progress(*columns, console=console, disable=not drawn) as progress:
        task = progress.add_task(printable(title), total=total, completed=begun, unit=unit, begun=begun, state="")

        def count(line: str = "", **changes: Any) -> None:
            progress.update(task, **(changes or {"advance": 1}))
            if line:
                print_line(console, line)

        def print_lines() -> None:
            while not ended.wait(SECONDS_BETWEEN_LINES):
                if not progress.finished:
                    with suppress(OSError):
                        print_line(console, f"{title}: {how_far.render(progress.tasks[0])}")

        thread = threading.Thread(target=print_lines, daemon=True)
        if not drawn:
            thread.start()
        try:
            yield count
        finally:
            ended.set()
            if not drawn:
                thread.join()


class _HowFar(ProgressColumn):
    def render(self, task: Task) -> Text:
        """What is done, in what time, and the time left."""
        seconds, made, unit = task.elapsed or 0.0, task.completed - task.fields["begun"], task.fields["unit"]
        of = "" if task.total is None else f"of {task.total:.0f} "
        count = f"{task.percentage:.0f} %" if unit == "%" else f"{task.completed:.0f} {of}{unit}".strip()
        parts = [
            count if task.completed or task.total else "",
            task.fields["state"],
            f"after {timedelta(seconds=round(seconds))}",
        ]
        if task.remaining and made > 0.0:
            parts.append(f"{timedelta(seconds=round(seconds / made * task.remaining))} left")
        return Text(", ".join(filter(None, parts)))


# Progress and closing tables of `taichisoft run`.


@contextmanager
def session_bar(console: Console, session: Session, title: str) -> Iterator[Callable[[StepReport], None]]:
    """Show the progress of a run; yields the function to call after every step.

    While a step waits for a kernel, which takes seconds the first time on a machine, the bar names it.
    """
    total = session.step_count if math.isfinite(session.step_count) else None
    with progress_bar(console, title, total, "steps") as count:

        def show(report: StepReport) -> None:
            count(advance=1, state=f"{report.time:.2f} s, {report.contact_count} contacts")

        # Nothing else is drawn while Taichi compiles.
        with compilations_shown(lambda name: count(state=f"preparing {name}", refresh=True)):
            yield show


def warn_if_slow(console: Console, session: Session) -> None:
    """Warn if a run was slower than its set speed."""
    pace = session.pace
    if pace.speed is not None and pace.mean_real_time_factor < KEEPING_UP * pace.speed:
        print_warning(
            console,
            f"could not keep up: {pace.mean_real_time_factor:.2f} s were simulated in a second, {pace.speed:g} s were "
            "asked for; a coarser mesh is faster",
        )


def print_profile(console: Console, profile: Profile) -> None:
    """Print the table of the phases of a step, in their order."""
    medians = profile.medians()
    whole = medians[TOTAL][0]
    table = Table("phase of a step", title=f"median times of {len(profile.seconds[TOTAL])} steps")
    for heading in ("[ms]", "share", "of it in Python [ms]"):
        table.add_column(plain(heading), justify="right")
    for phase, (seconds, in_python) in medians.items():
        table.add_row(phase, f"{seconds:.3f}", f"{seconds / whole:.0%}", f"{in_python:.3f}", end_section=phase == REST)
    console.print(table)


def print_summary(console: Console, parts: Sequence[Controller | Output], folder: Path) -> bool:
    """Print the closing table; returns False if a part failed, which must not hide the outcome of the run."""
    table = Table(show_header=False)
    complete = True
    for part in parts:
        try:
            for quantity, value in part.summary().items():
                table.add_row(plain(quantity), plain(value))
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            complete = False
            print_warning(console, str(plugin_failure(f"{type(part).__name__} failed in summary()", error)))
    if table.row_count:
        console.print(table)
    print_line(console, f"results in {folder}")
    return complete


# Lock for one run at a time in a folder, since two would write to the same files.

FILE_NAME = ".running"


class FolderTaken(TaichisoftError):
    """Another run is in progress in the folder."""


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """Lock a folder for this run; a missing folder is made, and removed again if it stays empty.

    The lock is a file lock of the operating system, so it ends with the process, however the process ends. On NFS it
    holds between machines if the server grants locks; on a file system without locks there is a warning.

    Raises:
        FolderTaken: another run has the lock.
        TaichisoftError: the folder cannot be made.
    """
    path = folder / FILE_NAME
    new_folders = [part for part in (folder, *folder.parents) if not part.exists()]
    with named_os_errors(f"--output {folder}"):
        folder.mkdir(parents=True, exist_ok=True)
        file = _locked(path, folder)
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(file)
        with suppress(OSError):  # a folder with files stays
            for part in new_folders:
                part.rmdir()


def _locked(path: Path, folder: Path) -> int:
    """Open and lock the file; a file that another run has just removed is no longer a lock and is made again."""
    import fcntl

    while True:
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            whose = os.read(file, 200).decode(errors="replace") or "another process"
            os.close(file)
            raise FolderTaken(
                f"--output {folder}: a run is going on there ({whose}); wait for its end, or name another folder"
            ) from None
        except OSError as error:
            warn_caller(f"--output {folder}: cannot be locked ({error.strerror}): see that no other run writes into it")
            return file
        if path.exists() and os.path.samestat(path.stat(), os.fstat(file)):
            os.ftruncate(file, 0)
            os.write(file, f"process {os.getpid()} on {socket.gethostname()}".encode())
            return file
        os.close(file)


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
        saved: memory that the controller resumes with, as its `save` gave it; None: `reset` alone.
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
            with (
                console.status(status) as shown,
                compilations_shown(lambda name: shown.update(f"preparing {name}")),
            ):
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
        with named_os_errors(f"--output {folder}"):
            (folder / "scene.toml").write_text(scene_to_toml(scene), encoding="utf-8")
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
    """Run with the status of an interactive run, or a progress bar; summaries are shown however the run ends."""
    is_steered = session.controller.interactive and not session.replaying
    display = live_status(console, session) if is_steered else session_bar(console, session, title)
    times: Profile | None = None
    measured: AbstractContextManager[Profile | None] = profiled(session.simulation) if profile else nullcontext()
    try:
        with display as show, measured as times:
            outcome = run_session(session, show)
    finally:
        complete = print_summary(console, [session.controller, *session.outputs], folder)
        warn_if_slow(console, session)
        if times is not None and times.seconds:
            print_profile(console, times)
    if not complete:
        raise typer.Exit(EXIT_FAILED)
    return outcome


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
