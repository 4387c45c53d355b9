"""The command `taichisoft render`."""

from pathlib import Path
from typing import Annotated

import typer

from taichisoft.errors import TaichisoftError
from taichisoft.terminal_text import say
from taichisoft_outputs.drawing.style import COLOURINGS, FPS, VIEWS, Style, parse_point, parse_size

STYLE = Style()


def render(
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
    colour_by: Annotated[
        str, typer.Option(help=f"What the colours of soft bodies mean: {', '.join(COLOURINGS)}.")
    ] = STYLE.colour_by,
    cavity_pressure: Annotated[bool, typer.Option(help="Colour cavities by their pressure.")] = STYLE.cavity_pressure,
    cable_tension: Annotated[bool, typer.Option(help="Colour cables by their tension.")] = STYLE.cable_tension,
    arrows: Annotated[bool, typer.Option(help="Draw contact forces as arrows.")] = STYLE.arrows,
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
    from taichisoft_outputs.rendering.render import key_moments, render_pictures
    from taichisoft_outputs.rendering.side_by_side import pictures_side_by_side, video_side_by_side
    from taichisoft_outputs.rendering.video import check_slow_motion, frame_progress, render_video
    from taichisoft_outputs.rendering.video_file import check_video

    if follow is not None:
        view = [*(view or ()), f"follow:{follow}"]
    if eye is not None and view:
        raise TaichisoftError("--eye takes the place of a view; give either --eye, or --view and --follow")
    views: list[str | None] = list(dict.fromkeys(view)) if view else [None]
    styles = {
        one: Style(
            size=parse_size(size),
            view=one,
            eye=parse_point("eye", eye),
            target=parse_point("target", target),
            opacity=opacity,
            background=background,
            colour_by=colour_by,
            cavity_pressure=cavity_pressure,
            cable_tension=cable_tension,
            arrows=arrows,
            axes=axes,
            body_axes=body_axes,
            caption=caption,
            surface=surface,
            section=section,
            font_size=font_size,
        )
        for one in views
    }
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
                with frame_progress(file.name) as show:
                    if others:
                        video_side_by_side(runs, file, style, fps, slow_motion, show)
                    else:
                        render_video(run, file, style, fps, slow_motion, show)
                say(file)
