"""The HTML of a report: one file that needs nothing beside it and no network."""

import base64
import mimetypes
import os
import re
from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

import taichisoft
from taichisoft_plugins.recording.reader import Recording
from taichisoft_plugins.report.contents import MediaFile, ReportContents

EMBEDDED_BYTES = 20_000_000
"""Size of pictures and videos up to which they are embedded; larger ones are linked."""

UNITS = {"mm": "mm", "mN": "mN", "s": "s", "ms": "ms"}
"""Units that stand at the end of a metric's name."""

HEADLINES = (
    *("object_lift_mm", "object_slip_mm", "object_distance_mm", "object_pushed_away_mm", "object_creep_mm"),
    *("mean_normal_force_mN", "real_time_factor"),
)
"""Metrics that stand large at the top."""

ACCURACY = {"mm": 1e-4, "mN": 1e-2, "s": 1e-4, "ms": 1e-3}
"""What is smaller, in a unit, is noise of the solver, and shown as 0."""

STYLE = """
:root { color-scheme: light; --line: #d9dde3; --faint: #5c6670; --good: #1a7f4b; --bad: #b3261e; }
body { margin: 0; background: #f4f5f7; color: #1c2126; font: 15px/1.5 system-ui, "DejaVu Sans", sans-serif; }
main { max-width: 1180px; margin: 0 auto; padding: 28px 24px 60px; }
h1 { margin: 0 0 4px; font-size: 28px; }
h2 { margin: 0 0 12px; font-size: 18px; }
section { margin-top: 20px; padding: 18px 20px; background: #fff; border: 1px solid var(--line); border-radius: 8px; }
.status { margin: 0 0 16px; color: var(--faint); }
.pill { margin-right: 8px; padding: 2px 10px; border-radius: 12px; color: #fff; font-weight: 600; }
.pill.good { background: var(--good); }
.pill.bad { background: var(--bad); }
em.bad { color: var(--bad); }
.cards { display: flex; flex-wrap: wrap; gap: 12px; }
.card { flex: 1 1 150px; padding: 10px 14px; background: #fff; border: 1px solid var(--line); border-radius: 8px; }
.card b { font-size: 24px; }
.card small { display: block; color: var(--faint); }
.figures { display: grid; grid-template-columns: repeat(auto-fit, minmax(320px, 1fr)); gap: 14px; }
figure { margin: 0; max-width: 780px; }
figure img, figure video { display: block; width: 100%; border: 1px solid var(--line); border-radius: 6px; }
figcaption { margin-top: 4px; color: var(--faint); text-align: center; }
.plots svg { display: block; width: 100%; height: auto; }
table { border-collapse: collapse; }
th, td { padding: 3px 14px 3px 0; border-bottom: 1px solid var(--line); text-align: left; vertical-align: top; }
th { color: var(--faint); font-weight: 400; white-space: nowrap; }
td { font-variant-numeric: tabular-nums; }
pre { overflow-x: auto; padding: 12px; background: #f4f5f7; border-radius: 6px; font-size: 13px; line-height: 1.35; }
summary { cursor: pointer; }
@media print { body { background: #fff; } section { break-inside: avoid; } }
"""


def report_page(contents: ReportContents, folder: Path) -> str:
    """The page.

    Args:
        contents: what the page shows.
        folder: folder in which the page will lie, for links to what is too large to embed.

    Raises:
        OSError: a picture or video cannot be read.
    """
    recording = contents.recording
    title = escape(recording.scene.title or recording.path.parent.resolve().name)
    scene = f"<details><summary>resolved scene</summary><pre>{escape(recording.scene_text)}</pre></details>"
    versions = {**recording.versions, "report by taichisoft": taichisoft.__version__}
    parts = [
        f"<h1>{title}</h1>",
        _status(recording, contents.metrics),
        _headlines(contents.metrics),
        _gallery("Pictures", contents.pictures, folder),
        _gallery("Video", contents.videos, folder),
        # An SVG file of its own begins with what does not belong into a page.
        _section("Plots", f'<div class="plots">{contents.plots[contents.plots.index("<svg") :]}</div>')
        if contents.plots
        else "",
        _signals(recording),
        _section("Metrics", _table(_rows(contents.metrics))) if contents.metrics else "",
        _section("What is not here", _list(contents.missing)) if contents.missing else "",
        _section("Scene", scene),
        _section("Versions", _table(versions.items())),
    ]
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{title}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<main>\n"
        + "\n".join(part for part in parts if part)
        + "\n</main>\n</body>\n</html>\n"
    )


def _status(recording: Recording, metrics: Mapping[str, Any]) -> str:
    """How the run ended, whether its object was held and how sure that is, and how long it took."""
    kind, reached = metrics.get("goal"), metrics.get("goal_reached")
    pills = [("good" if recording.outcome == "completed" else "bad", recording.outcome)]
    if reached is not None:
        pills.insert(0, ("good", f"{kind}") if reached else ("bad", f"not {kind}"))
        if reached and metrics.get("goal_is_doubtful"):
            steps = f"{metrics.get('unconverged_steps')} of {metrics.get('steps')} steps did not converge"
            pills[0] = ("bad", f"{kind}, doubtful: {steps}")
    elif kind is not None:
        pills.insert(0, ("bad", f"{kind}: not judged"))
    times = recording.times
    restarts = int((times[1:] < times[:-1]).sum())
    texts = [f"{times[-1]:g} s simulated"]
    if restarts:
        often = "once" if restarts == 1 else f"{restarts} times"
        texts.append(f"started anew {often}; shown is what came after the last start")
    texts.append(recording.path.name)
    shown = "".join(f'<span class="pill {kind}">{escape(text)}</span>' for kind, text in pills)
    return f'<p class="status">{shown}{escape(" · ".join(texts))}</p>'


def _headlines(metrics: Mapping[str, Any]) -> str:
    cards = []
    for name in HEADLINES:
        if isinstance(metrics.get(name), int | float):
            words, unit = _words(name)
            figure = f"<b>{_short(metrics[name], unit)}</b> {escape(unit)}"
            cards.append(f'<div class="card"><span>{figure}</span><small>{escape(words)}</small></div>')
    return f'<div class="cards">{"".join(cards)}</div>' if cards else ""


def _short(value: float, unit: str) -> str:
    if abs(value) < ACCURACY.get(unit, 0.0):
        return "0"
    return f"{value:z.0f}" if abs(value) >= 100.0 else f"{value:z.3g}"


def _signals(recording: Recording) -> str:
    """What the numbers of the controller's own were; nothing where it has none."""
    rows = []
    for name, values in zip(recording.signals, recording.column("signals").T, strict=False):
        known = values[np.isfinite(values)]
        if len(known):
            rows.append((name, f"{known[-1]:.4g} at last, from {known.min():.4g} to {known.max():.4g}"))
    return _section("Signals of the controller", _table(rows)) if rows else ""


def _gallery(title: str, media: list[MediaFile], folder: Path) -> str:
    figures = "".join(_figure(one, folder) for one in media)
    return _section(title, f'<div class="figures">{figures}</div>') if media else ""


def _figure(media: MediaFile, folder: Path) -> str:
    path = media.path
    name = escape(path.stem.replace("_", " "))
    warning = '<em class="bad"> older than this run; it may show another one</em>' if media.older_than_run else ""
    size = path.stat().st_size
    if size > EMBEDDED_BYTES:
        # Quoted, since a name may have a colon, and a browser would run "javascript:...", or a "#" or "?".
        link = quote(os.fsencode(Path(os.path.relpath(path, folder)).as_posix()))
        body = f'<p><a href="{link}">{escape(path.name)}</a>, {size / 1e6:.0f} MB, is too large to be embedded</p>'
    else:
        kind = mimetypes.guess_type(path.name)[0] or "application/octet-stream"
        data = f"data:{kind};base64,{base64.b64encode(path.read_bytes()).decode()}"
        is_video = kind.startswith("video/")
        body = (
            f'<video controls preload="metadata" src="{data}"></video>'
            if is_video
            else f'<img src="{data}" alt="{name}">'
        )
    return f"<figure>{body}<figcaption>{name}{warning}</figcaption></figure>"


def _rows(metrics: Mapping[str, Any]) -> Iterable[tuple[str, str]]:
    for name, value in metrics.items():
        words, unit = _words(name)
        small = isinstance(value, float) and abs(value) < ACCURACY.get(unit, 0.0)
        yield f"{words} [{unit}]" if unit else words, "0" if small else _value(value)


def _words(name: str) -> tuple[str, str]:
    """The words of a metric's name, and its unit: "object_lift_mm" is the object lift in mm."""
    words, _, last = name.rpartition("_")
    return (words.replace("_", " "), UNITS[last]) if last in UNITS and words else (name.replace("_", " "), "")


def _value(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "-"}[value]
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{name}: {_value(one)}" for name, one in value.items())
    if isinstance(value, list):
        return ", ".join(map(_value, value))
    return str(value)


def _table(rows: Iterable[tuple[str, str]]) -> str:
    body = "".join(f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows)
    return f"<table>{body}</table>"


def _list(sentences: Iterable[str]) -> str:
    """A list of sentences, in which commands in backquotes are set as code."""
    items = [re.sub(r"`([^`]*)`", r"<code>\1</code>", escape(sentence)) for sentence in sentences]
    return f"<ul>{''.join(f'<li>{item}</li>' for item in items)}</ul>"


def _section(title: str, body: str) -> str:
    return f"<section><h2>{escape(title)}</h2>{body}</section>"
