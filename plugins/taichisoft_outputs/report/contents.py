"""Contents of a report: what the folder of a run has, and what it lacks."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from taichisoft.errors import TaichisoftError
from taichisoft_outputs.metrics import FILE_NAME as METRICS
from taichisoft_outputs.plots.run_plots import draw_plots
from taichisoft_outputs.recording.reader import Recording

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
        recording: the recording, which stays open.
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
    contents.plots = [picture.decode() for picture in plots.pictures]
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
