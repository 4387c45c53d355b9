"""Several runs beside each other: their plots in one picture, and the keys and metrics in which they differ."""

import json
import tomllib
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft_outputs.plots import PANELS, Panel, RunCurves, draw_figure, figure_bytes
from taichisoft_outputs.recording.layout import FILE_NAME
from taichisoft_outputs.recording.reader import Recording, read_recording
from taichisoft_studies.errors import StudyError
from taichisoft_studies.results_table import WALL_CLOCK, flat

SCENE, METRICS = "scene.toml", "metrics.json"


def run_folder(run: Path) -> Path:
    """The folder of a run that is named by it, or by its recording."""
    folder = run if run.is_dir() else run.parent
    if not run.exists() or not (folder / SCENE).is_file():
        raise StudyError(
            f"{run}: is not a run; a folder with {SCENE} is needed, as `taichisoft run` and `study sweep` leave it"
        )
    return folder


def labels(folders: Sequence[Path]) -> list[str]:
    """A short name for each run: the end of its path, as long as needed to be unique."""
    parts = [folder.resolve().parts for folder in folders]
    for length in range(1, max(map(len, parts)) + 1):
        names = ["/".join(path[-length:]) for path in parts]
        if len(set(names)) == len(names):
            return names
    raise StudyError(f"{folders[0]}: is given twice")


def differences(folders: Sequence[Path]) -> dict[str, list[Any]]:
    """What differs between runs: keys of their scenes ("scene.KEY"), and metrics ("metrics.NAME").

    Returns:
        The value of each run by key, in the order of `folders`; None where it has none.
    """
    columns = []
    for folder in folders:
        scene = flat(_read(folder / SCENE, tomllib.loads))
        metrics = flat(_read(folder / METRICS, json.loads)) if (folder / METRICS).exists() else {}
        columns.append(
            {f"scene.{key}": value for key, value in scene.items()}
            | {f"metrics.{key}": value for key, value in metrics.items() if key not in WALL_CLOCK}
        )
    keys = dict.fromkeys(key for column in columns for key in column)
    rows = {key: [column.get(key) for column in columns] for key in keys}
    return {key: values for key, values in rows.items() if any(value != values[0] for value in values[1:])}


def draw_comparison(folders: Sequence[Path], names: Sequence[str], only: Sequence[str] | None, format: str) -> bytes:
    """The panels of all runs over each other, a colour for each run; the picture as "png" or "svg"."""
    for name in only or ():
        if name not in PANELS:
            raise StudyError(f"--only {name}: there are: {', '.join(PANELS)}")
    with ExitStack() as open_files:
        recordings = [open_files.enter_context(read_recording(folder / FILE_NAME)) for folder in folders]
        panels = [_overlaid(name, recordings, names) for name in only or PANELS]
    shown = [panel for panel in panels if panel.curves]
    if not shown:
        raise StudyError(f"{folders[0]}: nothing to plot in these runs")
    return figure_bytes(draw_figure(shown, names), format)


def _overlaid(name: str, recordings: Sequence[Recording], names: Sequence[str]) -> Panel:
    """One panel with the curves of all runs, a colour for each run."""
    panels = [PANELS[name](RunCurves(recording)) for recording in recordings]
    curves = [
        replace(curve, label=f"{run}: {curve.label}", body=run)
        for run, panel in zip(names, panels, strict=True)
        for curve in panel.curves
        if np.isfinite(curve.y).any()
    ]
    return replace(panels[0], curves=curves)


def _read(path: Path, parse: Any) -> Mapping[str, Any]:
    try:
        values: Mapping[str, Any] = parse(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise StudyError(f"{path}: not readable: {error}") from error
    return values
