"""Every figure is in CSV files, recordings, plots and metrics as it was observed."""

import csv
import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyvista
from cable_block import LINK, STEPS, TENDON, run_cables
from tiny_run import tiny_run

from taichisoft.control import BASE, FIGURES, PAIRS, Figure, In, text_of
from taichisoft.mechanics import CABLES
from taichisoft_outputs import Recording, read_recording
from taichisoft_outputs.csv_output import CsvOutput
from taichisoft_outputs.metrics import MetricsOutput
from taichisoft_outputs.paraview import export_vtu
from taichisoft_outputs.plots import PANELS, RunCurves, draw_plots, panel_name
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.report import write_report


@dataclass
class Run:
    """A run and what it has left; it is an output, which keeps the observations of the steps."""

    folder: Path
    model: Any = None
    observed: list[Any] = field(default_factory=list)
    summary: dict[str, str] = field(default_factory=dict)

    def begin(self, model: Any, state: Any) -> None:
        self.model = model

    def record(self, state: Any, report: Any) -> None:
        self.observed.append(report.observation.truth)

    def end(self, outcome: str) -> None:
        pass

    @property
    def rows(self) -> list[dict[str, str]]:
        with (self.folder / "run.csv").open(encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file, strict=True))

    @property
    def metrics(self) -> dict[str, Any]:
        return json.loads((self.folder / "metrics.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module", params=["pads", "cables", "none"])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Pads that carry a cube, a block with cables, or the same without."""
    folder = tmp_path_factory.mktemp(request.param)
    made, metrics = Run(folder), MetricsOutput(folder)
    outputs = [CsvOutput(folder), metrics, made]
    if request.param == "pads":
        hinge = "frames={lid={hinge={axis=[1.0,0.0,0.0]}}}"
        tiny_run(folder, [hinge], outputs=outputs)
    else:
        run_cables(folder, [RecordingOutput(folder), *outputs], request.param == "cables")
    made.summary = metrics.summary()
    return made


@pytest.fixture
def recording(run: Run) -> Iterator[Recording]:
    with read_recording(run.folder / "recording.h5") as opened:
        yield opened


def observed(run: Run, figure: Figure, name: Any) -> np.ndarray:
    """The values of a figure in the steps of a run, in its unit."""
    read = figure.reader(run.model)
    return np.array([figure.value(read(seen), name) for seen in run.observed])


@pytest.mark.parametrize("figure", FIGURES, ids=lambda figure: figure.name)
def test_figure_is_everywhere_as_it_was_observed(run: Run, recording: Recording, figure: Figure) -> None:
    names = recording.pairs if figure.per is PAIRS else figure.per.names(run.model)
    values = {name: observed(run, figure, name) for name in names}
    rows, metrics = run.rows, run.metrics
    for name in figure.per.names(run.model) if In.CSV in figure.recorded else ():
        for number, axis in enumerate(figure.axes or [""]):
            title = " ".join(filter(None, (figure.name, text_of(name), axis, f"[{figure.unit}]")))
            expected = values[name][:, number] if figure.axes else values[name]
            assert [float(row[title]) for row in rows] == pytest.approx(expected.tolist(), rel=1e-8, abs=1e-12)
    if In.RECORDING in figure.recorded and names:
        columns = recording.column(figure.name)[1:]
        np.testing.assert_allclose(columns, np.transpose([values[name] for name in names]), rtol=1e-12, atol=1e-12)
    if figure.drawn and names:
        panel = PANELS[panel_name(figure)](RunCurves(recording))
        assert panel.y_axis == figure.drawn
        expected_curves = {text_of(name): figure.factor * of for name, of in values.items()}
        if figure.per is BASE:
            expected_curves = dict(zip(figure.axes, values[""].T, strict=True))
        elif figure.axes:
            expected_curves = {name: np.linalg.norm(of, axis=1) for name, of in values.items()}
        for curve in panel.curves:
            np.testing.assert_allclose(curve.y[1:], expected_curves[curve.label], rtol=1e-12, atol=1e-12)
    if In.FINAL in figure.recorded:
        read = figure.reader(run.model)(run.observed[-1])
        final = {text_of(name): np.asarray(figure.value(read, name)).tolist() for name in read}
        assert metrics[figure.metric("final")] == final
    if In.LARGEST in figure.recorded and names:
        assert metrics[figure.metric("largest")] == {name: max(of.tolist(), key=abs) for name, of in values.items()}


def test_names_of_figures_are_unique() -> None:
    assert len({figure.name for figure in FIGURES}) == len({figure.field for figure in FIGURES}) == len(FIGURES)


@pytest.mark.parametrize("run", ["cables"], indirect=True)
def test_cables_are_in_plots_summary_report_and_paraview(run: Run, recording: Recording, tmp_path: Path) -> None:
    assert {"tension", "pull"} <= {*draw_plots(recording, "svg").shown}
    largest = run.metrics["largest_tensions_mN"][TENDON]
    assert run.summary["largest tension"] == f"{largest:.1f} mN (block.tendon)"
    assert run.summary["largest pull"].endswith(f" mm ({LINK})"), "the cube comes nearer"
    page = write_report(recording.path).read_text(encoding="utf-8")
    assert "largest tensions [mN]" in page and "largest pulls [mm]" in page and "pulled in by [mm]" in page
    export_vtu(recording, [0, STEPS], tmp_path)
    grid = pyvista.read(tmp_path / "cables" / f"{STEPS:05d}.vtu")
    np.testing.assert_allclose(grid.points, np.vstack(recording.cable_points(STEPS)), rtol=1e-6)
    assert set(grid.celltypes) == {3}
    ends = grid.cells.reshape(-1, 3)[:, 1:]
    assert ends.tolist() == [[0, 1], [1, 2], [2, 3], [3, 4], [5, 6]], "none from one cable to the next"
    assert grid.cell_data["cable"].tolist() == [0, 0, 0, 0, 1]
    tensions = np.concatenate(recording.segment_efforts(CABLES, STEPS))
    np.testing.assert_allclose(grid.cell_data["tension [mN]"], tensions, rtol=1e-6)
    pull = recording.row("pull", STEPS)
    np.testing.assert_allclose(grid.cell_data["pull [mm]"], pull[[0, 0, 0, 0, 1]], rtol=1e-6)


@pytest.mark.parametrize("run", ["none"], indirect=True)
def test_run_without_cables_has_nothing_of_them(run: Run, recording: Recording, tmp_path: Path) -> None:
    plots = draw_plots(recording, "svg")
    assert not {"tension", "pull"} & {*plots.shown, *plots.left_out}
    asked = draw_plots(recording, "svg", ["tension", "step-time"])
    assert (asked.shown, asked.left_out) == (("step-time",), ("tension",))
    names = [*run.rows[0], *run.metrics, *run.summary]
    assert not [name for name in names if any(word in name for word in ("tension", "pull", "cable"))]
    page = write_report(recording.path).read_text(encoding="utf-8")
    assert "tension" not in page.replace("lowest_tension", "").split("<h2>Scene</h2>")[0]
    export_vtu(recording, [0], tmp_path)
    assert not list(tmp_path.glob("cables*"))
