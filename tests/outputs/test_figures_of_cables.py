"""Plots, tables, metrics, the report and ParaView have the tensions, pulls and points of cables that were recorded."""

import csv
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import pyvista
from cable_block import LINK, STEPS, TENDON, run_cables

from taichisoft.mechanics import CABLES
from taichisoft_outputs import Recording, read_recording
from taichisoft_outputs.csv_output import CsvOutput
from taichisoft_outputs.metrics import MetricsOutput
from taichisoft_outputs.paraview import export_vtu
from taichisoft_outputs.plots import PANELS, RunCurves, draw_plots
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.report import write_report


@dataclass
class Run:
    """A run and what it has left."""

    folder: Path
    recording: Recording
    summary: dict[str, str]


def leave(folder: Path, cables: bool = True) -> dict[str, str]:
    """Run with outputs; returns what the metrics say at the end."""
    metrics = MetricsOutput(folder)
    run_cables(folder, [RecordingOutput(folder), CsvOutput(folder), metrics], cables)
    return metrics.summary()


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory):
    folder = tmp_path_factory.mktemp("cables")
    summary = leave(folder)
    with read_recording(folder / "recording.h5") as recording:
        yield Run(folder, recording, summary)


@pytest.fixture(scope="module")
def without(tmp_path_factory: pytest.TempPathFactory):
    folder = tmp_path_factory.mktemp("no cables")
    summary = leave(folder, cables=False)
    with read_recording(folder / "recording.h5") as recording:
        yield Run(folder, recording, summary)


def test_panels_of_tension_and_pull(run: Run) -> None:
    for panel, axis in (("tension", "tension [mN]"), ("pull", "pulled in by [mm]")):
        made = PANELS[panel](RunCurves(run.recording))
        assert made.y_axis == axis
        assert [(curve.label, curve.body) for curve in made.curves] == [(TENDON, "block"), (LINK, "block")]
        for column, curve in enumerate(made.curves):
            np.testing.assert_array_equal(curve.y, run.recording.column(panel)[:, column])
            np.testing.assert_array_equal(curve.x, run.recording.times)
    shown = draw_plots(run.recording, "svg").shown
    assert "tension" in shown and "pull" in shown


def test_a_run_without_cables_has_no_such_panels_and_does_not_miss_them(without: Run) -> None:
    plots = draw_plots(without.recording, "svg")
    assert not {"tension", "pull"} & {*plots.shown, *plots.left_out}
    asked = draw_plots(without.recording, "svg", ["tension", "step-time"])
    assert (asked.shown, asked.left_out) == (("step-time",), ("tension",))


def test_the_table_has_columns_of_every_cable(run: Run, without: Run) -> None:
    with (run.folder / "run.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file, strict=True))
    columns = {"tension {} [mN]": "tension", "pull {} [mm]": "pull", "cable_length {} [mm]": "cable_length"}
    for title, quantity in columns.items():
        for number, cable in enumerate((TENDON, LINK)):
            found = [float(row[title.format(cable)]) for row in rows]
            assert found == pytest.approx(run.recording.column(quantity)[1:, number].tolist(), rel=1e-8)
    names = (without.folder / "run.csv").read_text(encoding="utf-8").splitlines()[0]
    assert not any(word in names for word in ("tension", "pull", "cable"))


def test_metrics_have_the_largest_tension_and_pull_of_every_cable(run: Run, without: Run) -> None:
    metrics = json.loads((run.folder / "metrics.json").read_text(encoding="utf-8"))
    for name, quantity in (("largest_tensions_mN", "tension"), ("largest_pulls_mm", "pull")):
        values = run.recording.column(quantity)[1:]
        largest = values[np.abs(values).argmax(axis=0), [0, 1]]
        assert metrics[name] == dict(zip((TENDON, LINK), largest.tolist(), strict=True))
    assert run.summary["largest tension"] == f"{metrics['largest_tensions_mN'][TENDON]:.1f} mN (block.tendon)"
    assert run.summary["largest pull"].endswith(" mm (block.link)"), "the cube comes nearer"
    assert not [name for name in [*without.summary, *json.loads((without.folder / "metrics.json").read_text())]
                if "tension" in name or "pull" in name]  # fmt: skip


def test_the_report_shows_them(run: Run, without: Run) -> None:
    page = write_report(run.recording.path).read_text(encoding="utf-8")
    assert "largest tensions [mN]" in page and "largest pulls [mm]" in page and "pulled in by [mm]" in page
    page = write_report(without.recording.path).read_text(encoding="utf-8")
    assert "tension" not in page.replace("lowest_tension", "").split("<h2>Scene</h2>")[0]


def test_paraview_gets_lines_with_tension_and_pull(run: Run, without: Run, tmp_path: Path) -> None:
    export_vtu(run.recording, [0, STEPS], tmp_path / "with")
    grid = pyvista.read(tmp_path / "with" / "cables" / f"{STEPS:05d}.vtu")
    points = run.recording.cable_points(STEPS)
    np.testing.assert_allclose(grid.points, np.vstack(points), rtol=1e-6)
    assert set(grid.celltypes) == {3}
    ends = grid.cells.reshape(-1, 3)[:, 1:]
    assert ends.tolist() == [[0, 1], [1, 2], [2, 3], [3, 4], [5, 6]], "none from one cable to the next"
    assert grid.cell_data["cable"].tolist() == [0, 0, 0, 0, 1]
    np.testing.assert_allclose(
        grid.cell_data["tension [mN]"], np.concatenate(run.recording.segment_efforts(CABLES, STEPS)), rtol=1e-6
    )
    pull = run.recording.row("pull", STEPS)
    np.testing.assert_allclose(grid.cell_data["pull [mm]"], pull[[0, 0, 0, 0, 1]], rtol=1e-6)
    export_vtu(without.recording, [0], tmp_path / "without")
    assert not list((tmp_path / "without").glob("cables*"))
