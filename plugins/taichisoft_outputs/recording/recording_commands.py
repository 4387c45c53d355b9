"""The commands `taichisoft resume` and `taichisoft recording repair`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from taichisoft.plugin_system import GoalOption, OutputsOption, SpeedOption, requested, takes_run_options
from taichisoft.terminal_text import say

if TYPE_CHECKING:
    from taichisoft_outputs.recording.reader import Recording


@takes_run_options
def resume(
    context: typer.Context,
    run: Annotated[Path, typer.Argument(metavar="RUN.h5", help="Recording of a run, also of one that was killed.")],
    at: Annotated[float | None, typer.Option(help="Time to go on from \\[s]  \\[default: the last frame]")] = None,
    duration: Annotated[
        float | None,
        typer.Option(help="Simulated time from there \\[s]  \\[default: to the end of the scene]"),
    ] = None,
    controller: Annotated[str | None, typer.Option(help="Name of a controller  \\[default: the recorded one]")] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder for the results  \\[default: RUN's, with the time in its name]"),
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="Override a value of the recorded scene (repeatable).")
    ] = None,
    goal: GoalOption = None,
    outputs: OutputsOption = "recording,metrics",
    speed: SpeedOption = None,
    reset_controller: Annotated[
        bool, typer.Option("--reset-controller", help="Let the controller begin again instead of going on as it was.")
    ] = False,
) -> None:
    """Go on from a frame of a recording, into a new folder.

    The run continues to the bit, the controller included: it goes on with what it remembered then. One that does not
    save what it remembers, and another one than the recorded, begins with a reset.
    """
    import rich

    with rich.get_console().status("starting Taichi"):  # for which --help need not wait
        from taichisoft.running import RunRequest, run_simulation
    from taichisoft_outputs.recording.layout import FILE_NAME, RecordingError
    from taichisoft_outputs.recording.reader import read_recording
    from taichisoft_outputs.recording.resume import (
        base_has_moved,
        recorded_scene,
        remaining_time,
        resumed_simulation,
        saved_controller,
    )

    asked = requested(context, outputs)
    with read_recording(run) as recording:
        frame = recording.frame_count - 1 if at is None else recording.frame_at(at)
        scene = recorded_scene(recording, set_ or [], controller or asked.controller, goal)
        folder = output or _new_folder(recording, frame)
        if (folder / FILE_NAME).resolve() == run.resolve():
            raise RecordingError(f"--output {folder}: would replace the recording; name another folder")
        if scene.goal is not None and base_has_moved(recording, frame):
            typer.echo("the goal of the scene is not judged: the base had moved before")
            scene = scene.model_copy(update={"goal": None})
        saved, said = (None, "") if reset_controller else saved_controller(recording, frame, scene)
        typer.echo(f"going on from {recording.row('time', frame):g} s{said}")
        run_simulation(
            str(run),
            scene,
            lambda: resumed_simulation(recording, frame, scene),
            RunRequest(folder, asked.outputs, duration, speed, saved=saved),
            usual_duration=lambda: remaining_time(recording, frame, scene),
        )


def _new_folder(recording: "Recording", frame: int) -> Path:
    """A folder beside the recording's, with the time in its name."""
    folder = recording.path.resolve().parent
    return folder.with_name(f"{folder.name}-from-{recording.row('time', frame):.2f}s")


def repair(
    run: Annotated[Path, typer.Argument(metavar="RUN.h5", help="Recording, damaged or of a killed run; it stays.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="NEW.h5", help="The new recording.")],
) -> None:
    """Rescue the frames of a damaged recording that are whole; make an HDF5 file of that of a killed run."""
    from taichisoft_outputs.recording.repair import repair as rescue

    rescued = rescue(run, output)
    say(f"{output}: {len(rescued.whole)} of {rescued.frame_count} frames")
    if rescued.damage:
        say(f"the first that is not whole: {rescued.damage}")
