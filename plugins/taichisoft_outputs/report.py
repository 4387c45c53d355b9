"""The output "report": one page about a run."""

import base64
import json
import mimetypes
import os
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np

import taichisoft
from taichisoft.base import atomic_file
from taichisoft.errors import TaichisoftError
from taichisoft.running import Output
from taichisoft_outputs.html_template import render, svg_element
from taichisoft_outputs.metrics import FILE_NAME as METRICS
from taichisoft_outputs.plots import draw_plots
from taichisoft_outputs.recording.reader import Recording, read_recording
from taichisoft_outputs.recording.recording_output import NeededRecording

if TYPE_CHECKING:
    from taichisoft.contact import Model
    from taichisoft.mechanics import State
    from taichisoft.step import StepReport

# Contents of a report: what the folder of a run has, and what it lacks.

PICTURES, VIDEOS = (".png",), (".mp4", ".webm", ".gif")
MOMENTS = ("before", "grasped", "lifted", "after")
"""Pictures that begin with these words come first, in this order."""

CLOCK_STEP = 2.0
"""Steps in which some file systems know the time of a file [s]."""


@dataclass(frozen=True)
class MediaFile:
    """A picture or video.

    Attributes:
        path: the file.
        older_than_run: whether it was there before this run, so that it may show another one.
    """

    path: Path
    older_than_run: bool


@dataclass
class ReportContents:
    """Everything that a report shows.

    Attributes:
        recording: the recording, which stays open.
        pictures, videos: files in the order in which they are shown.
        metrics: figures of metrics.json by name.
        plots: content of an SVG file for each column of plots.
        missing: sentences about what the folder lacks.
    """

    recording: Recording
    pictures: list[MediaFile] = field(default_factory=list)
    videos: list[MediaFile] = field(default_factory=list)
    metrics: dict[str, Any] = field(default_factory=dict)
    plots: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)


def collect(recording: Recording, began: float | None = None) -> ReportContents:
    """Draw the plots of a recording, and look for what lies beside it.

    Args:
        began: time at which its run began [s since the epoch], to mark pictures of an earlier run in the same folder;
            None later, since copying a folder changes the times of its files.
    """
    contents = ReportContents(recording)
    _add_plots(contents)
    _add_media(contents, began)
    _add_metrics(contents)
    return contents


def _add_plots(contents: ReportContents) -> None:
    try:
        plots = draw_plots(contents.recording, "svg", columns_apart=True)
    except TaichisoftError as error:
        contents.missing.append(f"There are no plots: {error}.")
        return
    contents.plots = [picture.decode() for picture in plots.files]
    contents.missing += [f"No plot of {name}: this run has no such data." for name in plots.left_out]


def _add_media(contents: ReportContents, began: float | None) -> None:
    """Add all pictures and videos of the folder, except for the plots, which are drawn again."""
    start = 0.0 if began is None else began - CLOCK_STEP
    files = [path for path in contents.recording.path.parent.iterdir() if path.is_file()]
    found = sorted((path for path in files if not path.name.startswith((".", "plots."))), key=_rank)
    media = [MediaFile(path, path.stat().st_mtime < start) for path in found]
    contents.pictures = [one for one in media if one.path.suffix.lower() in PICTURES]
    contents.videos = [one for one in media if one.path.suffix.lower() in VIDEOS]
    if not contents.pictures:
        contents.missing.append(f"There are no pictures: `taichisoft render {contents.recording.path}` draws them.")


def _rank(path: Path) -> tuple[int, str]:
    first = [index for index, moment in enumerate(MOMENTS) if path.name.startswith(moment)]
    return (first[0] if first else len(MOMENTS), path.name)


def _add_metrics(contents: ReportContents) -> None:
    path = contents.recording.path.parent / METRICS
    try:
        metrics = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(metrics, dict):
            raise ValueError("not a table of figures")
        contents.metrics = metrics
    except FileNotFoundError:
        contents.missing.append("There are no metrics: the run was made without the output 'metrics'.")
    except (OSError, ValueError) as error:
        contents.missing.append(f"There are no metrics: {path} is not readable: {error}.")


# What the template report.html of a report shows, as texts.

TEMPLATE = Path(__file__).with_name("report.html")
EMBEDDED_BYTES = 20_000_000
"""Size of pictures and videos up to which they are embedded; larger ones are linked."""

UNITS = {
    **{unit: (unit, 1.0) for unit in ("mm", "mN", "s", "ms", "kPa", "kg", "degrees")},
    "mm2": ("mm²", 1.0),
    "mm3": ("cm³", 1e-3),
}
"""Units that stand at the end of a metric's name; how the page writes them, as the plots do, and the factor to that."""

HEADLINES = (
    *("object_lift_mm", "object_slip_mm", "object_distance_mm", "object_pushed_away_mm", "object_creep_mm"),
    *("mean_normal_force_mN", "real_time_factor"),
)
"""Metrics that stand large at the top."""

ACCURACY = {"mm": 1e-4, "mN": 1e-2, "s": 1e-4, "ms": 1e-3}
"""Values below this, by unit, are noise of the solver and shown as 0."""


def report_page(contents: ReportContents, folder: Path) -> str:
    """The page as HTML.

    Args:
        folder: folder in which the page will lie, for links to what is too large to embed.
    """
    recording, metrics = contents.recording, contents.metrics
    return render(
        TEMPLATE,
        title=recording.scene.title or recording.path.parent.resolve().name,
        pills=_pills(recording.outcome, metrics),
        status=_status(recording),
        headlines=list(_headlines(metrics)),
        galleries={
            "Pictures": [_figure(one, folder) for one in contents.pictures],
            "Video": [_figure(one, folder) for one in contents.videos],
        },
        plots=[svg_element(one) for one in contents.plots],
        signals=list(_signals(recording)),
        metrics=list(_rows(metrics)),
        missing=contents.missing,
        scene=recording.scene_text,
        versions={**recording.versions, "report by taichisoft": taichisoft.__version__},
    )


def _pills(outcome: str, metrics: Mapping[str, Any]) -> list[tuple[str, str]]:
    """How the run ended, and whether its goal was reached and how sure that is: "good" or "bad", and a text."""
    pills = [("good" if outcome == "completed" else "bad", outcome)]
    kind, reached = metrics.get("goal"), metrics.get("goal_reached")
    if kind is None and reached is None:
        return pills
    if reached and metrics.get("goal_is_doubtful"):
        steps = f"{metrics.get('unconverged_steps')} of {metrics.get('steps')} steps did not converge"
        return [("bad", f"{kind}, doubtful: {steps}"), *pills]
    goal = {True: ("good", f"{kind}"), False: ("bad", f"not {kind}"), None: ("bad", f"{kind}: not judged")}
    return [goal[None if reached is None else bool(reached)], *pills]


def _status(recording: Recording) -> str:
    times = recording.times
    restarts = int((times[1:] < times[:-1]).sum())
    texts = [f"{times[-1]:g} s simulated"]
    if restarts:
        often = "once" if restarts == 1 else f"{restarts} times"
        texts.append(f"restarted {often}; the report shows what came after the last start")
    return " · ".join([*texts, recording.path.name])


def _headlines(metrics: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    for name in HEADLINES:
        if isinstance(metrics.get(name), int | float):
            words, unit, factor = _words(name)
            if fingers := metrics.get(name.replace("force_", "forces_")) if "force_" in name else None:
                words += f" of {', '.join(fingers)} together"
            yield words, _short(factor * metrics[name], unit), unit


def _short(value: float, unit: str) -> str:
    if abs(value) < ACCURACY.get(unit, 0.0):
        return "0"
    return f"{value:z.0f}" if abs(value) >= 100.0 else f"{value:z.3g}"


def _signals(recording: Recording) -> Iterator[tuple[str, str]]:
    """The last value and the range of each signal of the controller."""
    for name, values in zip(recording.signals, recording.column("signals").T, strict=False):
        known = values[np.isfinite(values)]
        if len(known):
            yield name, f"{known[-1]:.4g} at last, from {known.min():.4g} to {known.max():.4g}"


def _figure(media: MediaFile, folder: Path) -> dict[str, Any]:
    """What the template shows of a picture or video: `data` if embedded, else `link` and `megabytes`."""
    path, size = media.path, media.path.stat().st_size
    kind = mimetypes.guess_type(path.name)[0] or "application/octet-stream"
    figure = {"name": path.stem.replace("_", " "), "media": media, "is_video": kind.startswith("video/")}
    if size > EMBEDDED_BYTES:
        # Quoted, since a name may have a colon, and a browser would run "javascript:...", or a "#" or "?".
        link = quote(os.fsencode(Path(os.path.relpath(path, folder)).as_posix()))
        return figure | {"link": link, "megabytes": f"{size / 1e6:.0f}"}
    return figure | {"link": "", "data": f"data:{kind};base64,{base64.b64encode(path.read_bytes()).decode()}"}


def _rows(metrics: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for name, value in metrics.items():
        words, unit, factor = _words(name)
        yield f"{words} [{unit}]" if unit else words, _value(value, factor, ACCURACY.get(unit, 0.0))


def _words(name: str) -> tuple[str, str, float]:
    """The words of a metric's name, its unit and the factor to that: "object_lift_mm" is the object lift in mm."""
    words, _, last = name.rpartition("_")
    return (words.replace("_", " "), *UNITS[last]) if last in UNITS and words else (name.replace("_", " "), "", 1.0)


def _value(value: Any, factor: float, least: float) -> str:
    """A value as text; numbers times a factor, and 0 below the least that is no noise."""
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "-"}[value]
    if isinstance(value, float):
        value *= factor
        return "0" if abs(value) < least else f"{value:.4g}" if abs(value) < 1e4 else f"{value:.0f}"
    if isinstance(value, Mapping):
        return ", ".join(f"{name}: {_value(one, factor, least)}" for name, one in value.items())
    if isinstance(value, list):
        return f"({', '.join(_value(one, factor, least) for one in value)})"
    return str(value)


# The output "report": one page with the pictures, plots and figures of a run, made at its end.

FILE_NAME = "report.html"


class ReportError(TaichisoftError):
    """A report cannot be written."""


class ReportOutput(Output):
    """Puts together what the outputs before it have left in the run's folder."""

    def __init__(self, folder: Path):
        self._recording = NeededRecording(folder)
        self._began: float | None = None

    def begin(self, model: "Model", state: "State") -> None:
        """Note the time: what is older in the folder belongs to another run."""
        self._recording.require("report")
        self._began = time.time()

    def record(self, state: "State", report: "StepReport") -> None:
        """Do nothing: the recording has all steps."""

    def end(self, outcome: str) -> None:
        """Write the page, also of a run that failed, unless it was interrupted or has no recording.

        A recording of an earlier run may lie in the folder.
        """
        if self._began is not None and outcome != "interrupted":
            write_report(self._recording.path, began=self._began)


def write_report(recording: Path, path: Path | None = None, began: float | None = None) -> Path:
    """Write the report of a recording, and return its path.

    Args:
        path: file of the report; report.html beside the recording when it is not given.
        began: time at which the run began, see `collect`.
    """
    path = path or recording.parent / FILE_NAME
    with read_recording(recording) as opened:
        contents = collect(opened, began)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            page = report_page(contents, path.parent)
        except OSError as error:
            raise ReportError(f"{path}: not written: {error}") from error
    with atomic_file(path, ReportError) as partial:
        partial.write_text(page, encoding="utf-8", errors="replace")  # names of files need not be text
    return path
