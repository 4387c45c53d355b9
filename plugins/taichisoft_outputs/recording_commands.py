"""The commands about recordings: resume, repair, export, report, plot, render and view."""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from taichisoft.base import extra, require, say
from taichisoft.errors import TaichisoftError
from taichisoft.running import GoalOption, OutputsOption, SpeedOption, requested, takes_run_options
from taichisoft_outputs.drawing.style import (
    COLOURINGS,
    FPS,
    VIEWS,
    Style,
    parse_point,
    parse_range,
    parse_size,
    read_key_frames,
)

if TYPE_CHECKING:
    from taichisoft_outputs.recording.reader import Recording

# The command `taichisoft recording export`.


def export(
    run: Annotated[Path, typer.Argument(metavar="RUN.h5", help="Recording of a run.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder of the files  \\[default: vtu or glb, beside RUN]")
    ] = None,
    every: Annotated[int | None, typer.Option(metavar="N", help="Each N-th recorded instant  \\[default: 1]")] = None,
    time: Annotated[list[float] | None, typer.Option(help="The instant nearest to it \\[s] (repeatable).")] = None,
    format: Annotated[
        str, typer.Option(help="vtu: all quantities, for ParaView; glb: coloured surfaces, for Blender and slides.")
    ] = "vtu",
) -> None:
    """Write the instants of a recording for ParaView, or as glTF."""
    from rich.console import Console  # --help need not wait for any of these

    from taichisoft.running import progress_bar
    from taichisoft_outputs.paraview import EXPORTS, ExportError, chosen_instants
    from taichisoft_outputs.recording.reader import read_recording

    if format not in EXPORTS:
        raise ExportError(
            f"--format {format}: must be {' or '.join(EXPORTS)}; `recording plot` has csv and xlsx, of curves"
        )
    with read_recording(run) as recording:
        instants = chosen_instants(recording, every, time)
        if recording.last_start and not time:
            typer.echo(f"the run was restarted; only the {len(instants)} instants after the last start are exported")
        with progress_bar(Console(stderr=True), "exporting", len(instants), "instants") as count:
            written = EXPORTS[format](recording, _counted(instants, count), output or run.parent / format)
    for path in written:
        say(path)


def _counted(instants: Sequence[int], count: Callable[[], None]) -> Iterator[int]:
    for instant in instants:
        yield instant
        count()


# The command `taichisoft recording report`.


def report(
    run: Annotated[Path, typer.Argument(metavar="RUN.h5", help="Recording of a run.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="The page  \\[default: report.html beside RUN]")
    ] = None,
) -> None:
    """Write one page with the pictures in a run's folder, its plots, metrics and scene."""
    from taichisoft_outputs.report import write_report  # --help need not wait for it

    say(write_report(run, output))


# The command `taichisoft recording plot`.


def plot(
    run: Annotated[Path, typer.Argument(metavar="RUN.h5", help="Recording of a run.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder of the picture  \\[default: RUN's]")
    ] = None,
    format: Annotated[
        str, typer.Option(help="png, svg, or numbers: csv, or xlsx with a sheet for each panel.")
    ] = "png",
    only: Annotated[
        str | None,
        typer.Option(metavar="NAMES", help="Panels, such as bending,slip; one that is unknown is answered with all."),
    ] = None,
    x: Annotated[
        str | None, typer.Option("--x", metavar="NAME", help="Horizontal axis instead of time, such as pressure.")
    ] = None,
    y: Annotated[
        str | None, typer.Option("--y", metavar="NAMES", help="What is plotted over it, such as bending; as --only.")
    ] = None,
    line: Annotated[
        str | None,
        typer.Option(metavar="X,Y,Z:X,Y,Z", help="Stress along a line through bodies at rest \\[mm], also as a table."),
    ] = None,
    time: Annotated[
        list[float] | None, typer.Option(help="Moment of it \\[s] (repeatable)  \\[default: the last instant]")
    ] = None,
) -> None:
    """Plot pressures, tensions, motion, forces and step times of a recording, or stress along a line."""
    from taichisoft.base import atomic_file  # --help need not wait for any of these
    from taichisoft_outputs.plots import PANELS, PlotError, draw_plots, files_of, line_panels
    from taichisoft_outputs.recording.reader import read_recording
    from taichisoft_outputs.stress import parse_line, stress_along

    if (x is None) != (y is None):
        raise PlotError("--x and --y go together: --x pressure --y bending")
    if y is not None and only is not None:
        raise PlotError("--only has no effect beside --y, which names what is plotted")
    only = only if y is None else y
    names = [name.strip() for name in only.split(",") if name.strip()] if only is not None else None
    if names == []:
        raise PlotError(f"--only names no panel; there are: {', '.join(PANELS)}")
    if line is not None and only is not None:
        raise PlotError("--line draws stress over distance; --only, --x and --y have no effect beside it")
    if line is None and time:
        raise PlotError("--time is a moment of --line; other plots show all moments")
    stem = "plots" if x is None else f"{'-'.join(names or ())}-over-{x}".replace(" ", "-")
    with read_recording(run) as recording:
        if line is None:
            plots = draw_plots(recording, format, names, None if x == "time" else x)
            content = {format: plots.files[0]}
            for name in plots.left_out:
                say(f"no plot of {name}: nothing of the kind in this run")
        else:
            stem, ends, moments = "stress-along-line", parse_line(line), time or [recording.times[-1]]
            along = stress_along(recording, ends, sorted({recording.instant_at(moment) for moment in moments}))
            panels, bodies = line_panels(along), [f"{moment:g} s" for moment in along.times]
            content = {kind: files_of(panels, bodies, kind)[0] for kind in dict.fromkeys((format, "csv"))}
    for kind, data in content.items():
        path = (output or run.parent) / f"{stem}.{kind}"
        with atomic_file(path, PlotError) as partial:
            path.parent.mkdir(parents=True, exist_ok=True)
            partial.write_bytes(data)
        say(path)


# The command `taichisoft render`.

STYLE = Style()


def render(
    context: typer.Context,
    runs: Annotated[
        list[Path], typer.Argument(metavar="RUN.h5", help="Recording of a run; several with --side-by-side.")
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder of the pictures  \\[default: RUN's]")
    ] = None,
    image: Annotated[bool, typer.Option("--image", help="Draw pictures; always without --video.")] = False,
    time: Annotated[
        list[float] | None,
        typer.Option(help="Moment of a picture \\[s]; may be repeated  \\[default: before, grasped, lifted]"),
    ] = None,
    video: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw a video: .mp4, .gif, or a folder for PNG files.")
    ] = None,
    fps: Annotated[float, typer.Option(help="Frames per second of the video.")] = FPS,
    slow_motion: Annotated[float, typer.Option(help="How many times slower than in reality things move.")] = 1.0,
    size: Annotated[str, typer.Option(help="Width and height in pixels.")] = "{}x{}".format(*STYLE.size),
    view: Annotated[
        list[str] | None,
        typer.Option(
            help=f"Where the camera stands: {', '.join(VIEWS)}; each of several gets its own files  "
            "\\[default: the scene's camera, or iso]"
        ),
    ] = None,
    eye: Annotated[
        str | None, typer.Option(metavar="X,Y,Z", help="Where the camera stands instead of a view \\[mm].")
    ] = None,
    target: Annotated[
        str | None,
        typer.Option(metavar="X,Y,Z", help="What it looks at from there \\[mm]  \\[default: middle of the scene]"),
    ] = None,
    key_frames: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="CSV file through which the camera moves: time \\[s], eye x, y, z, target x, y, z \\[mm].",
        ),
    ] = None,
    follow: Annotated[
        str | None,
        typer.Option(
            metavar="BODY", help="Stay near a body, or a fingertip (finger.tip): --view follow:BODY in short."
        ),
    ] = None,
    section: Annotated[
        str | None,
        typer.Option(metavar="PLANE", help="Cut bodies open: y=0 \\[mm], or y<0, which keeps that part."),
    ] = None,
    side_by_side: Annotated[
        bool, typer.Option("--side-by-side", help="Several recordings in one picture: same times, same bars, names.")
    ] = False,
    opacity: Annotated[
        float | None,
        typer.Option(help="Opacity of soft bodies, up to 1  \\[default: 0.6; 1 with data or a section]"),
    ] = None,
    background: Annotated[
        str | None, typer.Option(metavar="#RRGGBB", help="Colour behind everything  \\[default: the scene's]")
    ] = None,
    transparent: Annotated[bool, typer.Option("--transparent", help="No background but shadows.")] = False,
    colour_by: Annotated[
        str, typer.Option(help=f"What the colours of soft bodies mean: {', '.join(COLOURINGS)}.")
    ] = STYLE.colour_by,
    colour_range: Annotated[
        str | None,
        typer.Option(metavar="LOW:HIGH", help="Values of the first and last of them  \\[default: what is reached]"),
    ] = None,
    colour_map: Annotated[
        str, typer.Option(metavar="NAME", help="Map of Matplotlib for them, such as viridis.")
    ] = STYLE.colour_map,
    cavity_pressure: Annotated[bool, typer.Option(help="Colour cavities by their pressure.")] = STYLE.cavity_pressure,
    cable_tension: Annotated[bool, typer.Option(help="Colour cables by their tension.")] = STYLE.cable_tension,
    arrows: Annotated[bool, typer.Option(help="Draw contact forces as arrows.")] = STYLE.arrows,
    displacement_arrows: Annotated[
        float | None,
        typer.Option(metavar="TIMES", help="Arrows of the displacement, so many times as long; 1 is as long as it is."),
    ] = None,
    scale_bar: Annotated[bool, typer.Option("--scale-bar", help="Draw a bar that shows how long mm are.")] = False,
    axes: Annotated[
        bool | None,
        typer.Option("--axes/--no-axes", help="Show the scene's axes in a corner  \\[default: the scene's]"),
    ] = None,
    body_axes: Annotated[
        bool, typer.Option(help="Show the axes of bodies that have axes = true in the scene.")
    ] = STYLE.body_axes,
    caption: Annotated[bool, typer.Option(help="Write time, pressures, tensions and heights.")] = STYLE.caption,
    font_size: Annotated[
        float | None, typer.Option(help="Height of letters in pixels  \\[default: 1/36 of the height]")
    ] = None,
    surface: Annotated[
        Path | None, typer.Option(help="Finer surface (STL, OBJ, PLY) to draw instead of each soft body's own.")
    ] = None,
) -> None:
    """Draw pictures or a video of a recording; no display is needed.

    A run that its user restarted is drawn from its last start.
    """
    import rich  # --help need not wait for any of these

    from taichisoft.running import warnings_printed_to
    from taichisoft_outputs.recording.reader import read_recording
    from taichisoft_outputs.rendering.side_by_side import pictures_side_by_side, video_side_by_side
    from taichisoft_outputs.rendering.video import (
        check_slow_motion,
        check_video,
        key_moments,
        picture_progress,
        render_pictures,
        render_video,
    )

    if follow is not None:
        view = [*(view or ()), f"follow:{follow}"]
    if eye is not None and view:
        raise TaichisoftError("--eye takes the place of a view; give either --eye, or --view and --follow")
    views: list[str | None] = list(dict.fromkeys(view)) if view else [None]
    chosen = {name: value for name, value in context.params.items() if name in STYLE.__dataclass_fields__}
    chosen |= {
        "size": parse_size(size),
        "eye": parse_point("eye", eye),
        "target": parse_point("target", target),
        "key_frames": [] if key_frames is None else read_key_frames(key_frames),
        "colour_range": parse_range(colour_range),
    }
    styles = {one: Style(**{**chosen, "view": one}) for one in views}
    check_slow_motion(slow_motion)
    if video is not None:
        check_video(video, fps)
    run, *others = runs
    if bool(others) != side_by_side:
        raise TaichisoftError("--side-by-side goes with two recordings or more, and several recordings with it")
    with read_recording(run) as recording:
        moments = {f"at_{moment:.2f}s": moment for moment in time} if time else key_moments(recording)
    with warnings_printed_to(rich.get_console()):
        for one, style in styles.items():
            ending = f"_{one.replace(':', '_')}" if one is not None and len(styles) > 1 else ""
            if image or time or video is None:
                times = {name + "_side_by_side" * side_by_side + ending: moment for name, moment in moments.items()}
                folder = output or run.parent
                drawn = pictures_side_by_side(runs, times, folder, style) if others else None
                for path in drawn or render_pictures(run, times, folder, style):
                    say(path)
            if video is not None:
                file = video.with_name(f"{video.stem}{ending}{video.suffix}")
                with picture_progress(file.name) as show:
                    if others:
                        video_side_by_side(runs, file, style, fps, slow_motion, show)
                    else:
                        render_video(run, file, style, fps, slow_motion, show)
                say(file)


# The command `taichisoft view`.


def view(
    run: Annotated[Path, typer.Argument(metavar="RUN.h5", help="Recording of a run, also of one that goes on.")],
    address: Annotated[
        str | None,
        typer.Option(metavar="HOST:PORT", help="Where the page listens  \\[default: 127.0.0.1 and a free port]"),
    ] = None,
    section: Annotated[
        str, typer.Option(metavar="PLANE", help="Cut bodies open \\[mm]: y=0, z<12.5 (what is kept), x+2*y=30")
    ] = "",
) -> None:
    """Serve a web page on which a recording is played and scrubbed."""
    from taichisoft_outputs.web.address import NOT_ENCRYPTED, find_address

    require("a web page", "viser", install=extra("web"))
    from taichisoft_outputs.web.recording_page import RecordingPage

    found = find_address(address)
    with contextlib.redirect_stdout(None):  # viser prints where it listens, in its own way
        served = RecordingPage(run, found, section)
    typer.echo(f"web page: {found.at(served.page.port).url}; Ctrl and c ends it")
    if found.is_open:
        typer.echo(f"warning: {found.host}: other machines reach the page; {NOT_ENCRYPTED}", err=True)
    with contextlib.redirect_stdout(None):
        with contextlib.suppress(KeyboardInterrupt):
            served.serve()
        served.close()


# The commands `taichisoft resume` and `taichisoft recording repair`.


@takes_run_options
def resume(
    context: typer.Context,
    run: Annotated[Path, typer.Argument(metavar="RUN.h5", help="Recording of a run, also of one that was killed.")],
    at: Annotated[float | None, typer.Option(help="Time to go on from \\[s]  \\[default: the last instant]")] = None,
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
    """Go on from an instant of a recording, into a new folder.

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
        instant = recording.instant_count - 1 if at is None else recording.instant_at(at)
        scene = recorded_scene(recording, set_ or [], controller or asked.controller, goal)
        folder = output or _new_folder(recording, instant)
        if (folder / FILE_NAME).resolve() == run.resolve():
            raise RecordingError(f"--output {folder}: would replace the recording; name another folder")
        if scene.goal is not None and base_has_moved(recording, instant):
            typer.echo("the goal of the scene is not judged: the base had moved before")
            scene = scene.model_copy(update={"goal": None})
        saved, said = (None, "") if reset_controller else saved_controller(recording, instant, scene)
        typer.echo(f"going on from {recording.row('time', instant):g} s{said}")
        run_simulation(
            str(run),
            scene,
            lambda: resumed_simulation(recording, instant, scene),
            RunRequest(folder, asked.outputs, duration, speed, saved=saved),
            usual_duration=lambda: remaining_time(recording, instant, scene),
        )


def _new_folder(recording: "Recording", instant: int) -> Path:
    folder = recording.path.resolve().parent
    return folder.with_name(f"{folder.name}-from-{recording.row('time', instant):.2f}s")


def repair(
    run: Annotated[Path, typer.Argument(metavar="RUN.h5", help="Recording, damaged or of a killed run; it stays.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="NEW.h5", help="The new recording.")],
) -> None:
    """Rescue the instants of a damaged recording that are whole; make an HDF5 file of that of a killed run."""
    from taichisoft_outputs.recording.reader import read_recording

    with read_recording(run) as recording:
        rescued = recording.rescue(output)
    say(f"{output}: {len(rescued.whole)} of {rescued.instant_count} instants")
    if rescued.damage:
        say(f"the first that is not whole: {rescued.damage}")
