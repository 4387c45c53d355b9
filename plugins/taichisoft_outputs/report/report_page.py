"""What the template report.html of a report shows, as texts."""

import base64
import mimetypes
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

import taichisoft
from taichisoft_outputs.html_template import render, svg_element
from taichisoft_outputs.recording.reader import Recording
from taichisoft_outputs.report.contents import MediaFile, ReportContents

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
        contents: what the page shows.
        folder: folder in which the page will lie, for links to what is too large to embed.

    Raises:
        OSError: a picture or video cannot be read.
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
    """How long the run took, and how often it was restarted."""
    times = recording.times
    restarts = int((times[1:] < times[:-1]).sum())
    texts = [f"{times[-1]:g} s simulated"]
    if restarts:
        often = "once" if restarts == 1 else f"{restarts} times"
        texts.append(f"restarted {often}; the report shows what came after the last start")
    return " · ".join([*texts, recording.path.name])


def _headlines(metrics: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Words, value and unit of each headline metric."""
    for name in HEADLINES:
        if isinstance(metrics.get(name), int | float):
            words, unit, factor = _words(name)
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
