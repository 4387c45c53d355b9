"""What a report shows: found in the folder of a run, or said to be missing."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import taichisoft
from taichisoft.errors import TaichisoftError
from taichisoft_plugins.metrics import FILE_NAME as METRICS
from taichisoft_plugins.plots.plots import draw_plots
from taichisoft_plugins.recording.reader import Recording, read_recording

PICTURES, VIDEOS = (".png",), (".mp4", ".webm", ".gif")
MOMENTS = ("before", "grasped", "lifted", "after")
"""Pictures that begin with these words come first, in this order."""

CLOCK_STEP = 2.0
"""Some file systems know the time of a file to this only [s]."""


@dataclass(frozen=True)
class Shown:
    """A picture or video.

    Attributes:
        path: the file.
        earlier: it is older than this run, so it may show another one.
    """

    path: Path
    earlier: bool


@dataclass
class ReportContents:
    """Everything that a report shows.

    Attributes:
        title: of the scene.
        outcome: how the run ended.
        recording: the file.
        duration: simulated time since the last start [s].
        restarts: how often the run was started anew.
        pictures, videos: in the order in which they are shown.
        metrics: what metrics.json has.
        plots: an SVG file, or "" if there is none.
        scene: resolved, as TOML.
        versions: of what the run was computed with, and of what makes the report, by name.
        missing: what the report has to do without, one sentence each.
    """

    title: str
    outcome: str
    recording: Path
    duration: float
    restarts: int
    scene: str
    pictures: list[Shown] = field(default_factory=list)
    videos: list[Shown] = field(default_factory=list)
    metrics: dict[str, Any] = field(default_factory=dict)
    plots: str = ""
    versions: dict[str, str] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)


def collect(path: Path, began: float | None = None) -> ReportContents:
    """Look at a recording and what lies beside it.

    Args:
        path: the recording.
        began: when its run began [s since the epoch], to tell pictures of an earlier run in the same folder. Later that
            cannot be told: to copy a folder changes the times of its files.

    Raises:
        RecordingError: there is no such recording.
    """
    folder = path.parent
    with read_recording(path) as recording:
        times = recording.times
        contents = ReportContents(
            title=recording.scene.title or path.parent.resolve().name,
            outcome=recording.outcome,
            recording=path,
            duration=float(times[-1]) if len(times) else 0.0,
            restarts=int((times[1:] < times[:-1]).sum()),
            scene=recording.scene_text,
            versions={**recording.versions, "report by taichisoft": taichisoft.__version__},
        )
        _add_plots(contents, recording)
    _add_pictures(contents, folder, began)
    _add_metrics(contents, folder)
    return contents


def _add_plots(contents: ReportContents, recording: Recording) -> None:
    try:
        plots = draw_plots(recording, "svg")
    except TaichisoftError as error:
        contents.missing.append(f"There are no plots: {error}.")
        return
    contents.plots = plots.picture.decode()
    contents.missing += [f"There is no plot of {name}: nothing of the kind in this run." for name in plots.left_out]


def _add_pictures(contents: ReportContents, folder: Path, began: float | None) -> None:
    """Everything in the folder that can be looked at, but for the plots, which are drawn anew."""
    start = 0.0 if began is None else began - CLOCK_STEP
    found = sorted(path for path in folder.iterdir() if path.is_file() and not path.name.startswith((".", "plots.")))
    shown = [Shown(path, path.stat().st_mtime < start) for path in sorted(found, key=_rank)]
    contents.pictures = [one for one in shown if one.path.suffix.lower() in PICTURES]
    contents.videos = [one for one in shown if one.path.suffix.lower() in VIDEOS]
    if not contents.pictures:
        contents.missing.append(f"There are no pictures: `taichisoft render {contents.recording}` draws them.")


def _rank(path: Path) -> tuple[int, str]:
    first = [index for index, moment in enumerate(MOMENTS) if path.name.startswith(moment)]
    return (first[0] if first else len(MOMENTS), path.name)


def _add_metrics(contents: ReportContents, folder: Path) -> None:
    path = folder / METRICS
    try:
        metrics = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(metrics, dict):
            raise ValueError("no table of figures")
        contents.metrics = metrics
    except FileNotFoundError:
        contents.missing.append("There are no metrics: the run was made without the output 'metrics'.")
    except (OSError, ValueError) as error:
        contents.missing.append(f"There are no metrics: {path} is not readable: {error}.")
