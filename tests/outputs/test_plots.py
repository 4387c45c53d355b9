"""`taichisoft recording plot`: the curves are what was observed in the run, and every panel can be read."""

import io
from contextlib import suppress
from pathlib import Path
from xml.etree import ElementTree

import fake_run
import numpy as np
import pytest
import tiny_run

from taichisoft import Observation
from taichisoft.errors import GoalMissed
from taichisoft_outputs import Recording, read_recording
from taichisoft_outputs.metrics import MetricsOutput
from taichisoft_outputs.plots import (
    PANELS,
    TIME_AXIS,
    Panel,
    PlotCurve,
    PlotError,
    RunCurves,
    against,
    draw_figure,
    draw_plots,
    expected,
    files_of,
    pieces,
)
from taichisoft_outputs.recording.recording_output import RecordingOutput

SINGLE = 1e-5
"""Positions are recorded in single precision: angles [degrees] and places [mm] differ by less."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Observation]]:
    """A run that was started anew after 20 of its steps, and its observations in every frame."""
    folder = tmp_path_factory.mktemp("run")
    observed = tiny_run.tiny_run(folder, restart_after=20)
    return folder / "recording.h5", observed


@pytest.fixture
def recording(run: tuple[Path, list[Observation]]):
    with read_recording(run[0]) as opened:
        yield opened


@pytest.fixture
def observed(run: tuple[Path, list[Observation]]) -> list[Observation]:
    return run[1]


def curves(recording: Recording, panel: str) -> dict[str, PlotCurve]:
    return {curve.label: curve for curve in PANELS[panel](RunCurves(recording)).curves}


def axes_of(svg: Path) -> set[str]:
    """Names of the axes with units, but for the time."""
    words = {(element.text or "").strip() for element in ElementTree.parse(svg).getroot().iter()}
    return {word for word in words if word.endswith("]")} - {TIME_AXIS}


def test_tips_and_bending_are_those_that_a_controller_observes(
    recording: Recording, observed: list[Observation]
) -> None:
    """Degrees of the bending angle; paths along two horizontal axes and upwards, which is z here."""
    bending = curves(recording, "bending")
    side, above = curves(recording, "tips-side"), curves(recording, "tips-above")
    assert list(bending) == ["left", "right"]
    for name in bending:
        angles = [np.degrees(seen.bending_angles[name]) for seen in observed]
        np.testing.assert_allclose(bending[name].y, angles, atol=SINGLE)
        positions = np.array([seen.tip_positions[name] for seen in observed])
        np.testing.assert_allclose(np.column_stack([above[name].x, above[name].y]), positions[:, :2], atol=SINGLE)
        np.testing.assert_allclose(side[name].y, positions[:, 2], atol=SINGLE)
        assert np.ptp(positions[:, 2]) > 1.0, "the tips rise with the base"


def test_height_counts_from_each_start(recording: Recording, observed: list[Observation]) -> None:
    height = curves(recording, "height")
    cube = np.array([seen.object_positions["cube"][2] for seen in observed])
    base = np.array([seen.base_translation[2] for seen in observed])
    before = np.flatnonzero(base > 0.0)[0] - 1
    np.testing.assert_allclose(height["cube"].y[before:], cube[before:] - cube[before], atol=1e-12)
    np.testing.assert_allclose(height["base"].y, base, atol=1e-12)
    assert height["base"].y[-1] == pytest.approx(4.0), "0.1 s at 40 mm/s"


def test_a_base_that_stands_still_in_a_scene_without_objects_is_not_worth_a_panel(tmp_path: Path) -> None:
    """The body of a made-up run is left alone, with a base at rest or not; it has no anchors, so it is no finger."""
    for steps, shown in ((3, False), (9, True)):
        fake_run.fake_run([RecordingOutput(tmp_path / str(steps))], steps=steps)
        with read_recording(tmp_path / str(steps) / "recording.h5") as recording:
            recording.scene = recording.scene.model_copy(update={"rigid_bodies": {}})
            plots = draw_plots(recording, "svg")
        assert ("height" in plots.shown) is shown
        assert ("height" in plots.left_out) is not shown
        assert "bending" in plots.left_out


def test_slip_is_that_of_the_metrics_and_there_is_none_before_the_base_moves(tmp_path: Path) -> None:
    """Also where frames are several steps apart: each has the slip of all steps since the one before."""
    metrics = MetricsOutput(tmp_path)
    with suppress(GoalMissed):
        tiny_run.tiny_run(tmp_path, ["goal={object='cube'}"], outputs=[metrics], every=3)
    with read_recording(tmp_path / "recording.h5") as recording:
        slip = curves(recording, "slip")["cube"].y
    assert np.isnan(slip[: tiny_run.LIFT_AFTER // 3]).all()
    assert slip[tiny_run.LIFT_AFTER // 3] == 0.0
    assert slip[-1] == pytest.approx(metrics.metrics["object_slip_mm"], abs=1e-12)
    assert abs(slip[-1]) > 1e-6


def test_forces_are_those_of_pairs_that_touched(recording: Recording) -> None:
    assert set(curves(recording, "normal-force")) == {"left|cube", "right|cube", "cube|floor"}


def test_step_time_has_no_value_where_no_step_was_made(recording: Recording) -> None:
    panel = PANELS["step-time"](RunCurves(recording))
    (curve,) = panel.curves
    assert np.flatnonzero(np.isnan(curve.y)).tolist() == [0, 21]
    np.testing.assert_allclose(curve.y[1], 1e3 * recording.column("step_time")[1])
    assert panel.level == (10.0, "real time")


def test_where_frames_are_several_steps_apart_the_step_time_is_called_a_mean(tmp_path: Path) -> None:
    tiny_run.tiny_run(tmp_path, every=10)
    with read_recording(tmp_path / "recording.h5") as recording:
        assert list(curves(recording, "step-time")) == ["mean of 10 steps"]
        assert len(curves(recording, "pressure")["left.cavity"].x) == 5


def test_no_line_runs_back_in_time(recording: Recording) -> None:
    """A run that was started anew is drawn start by start, the earlier one paler and not in the legend again."""
    assert pieces(recording.times) == [(0, 21), (21, 62)]
    axes = draw_figure([PANELS["height"](RunCurves(recording))], ["cube"]).axes[0]
    for line in axes.lines:
        assert (np.diff(line.get_xdata()) >= 0.0).all()
    assert [line.get_alpha() for line in axes.lines] == [0.3, 1.0, 0.3, 1.0]
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["cube", "base"]


def test_curves_on_each_other_are_drawn_once_with_all_names() -> None:
    """And with a width of each that lets those below be seen."""
    time = np.linspace(0.0, 1.0, 5)
    same, other = [PlotCurve(name, name, time, time**2, time) for name in "ab"], PlotCurve("c", "c", time, time, time)
    axes = draw_figure([Panel("x", "y", [*same, other])], ["a", "b", "c"]).axes[0]
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["a, b", "c"]
    assert axes.lines[0].get_linewidth() > axes.lines[1].get_linewidth()


def test_curves_near_each_other_are_dashed() -> None:
    """By 1 % of the height of the panel: the upper ones leave parts of the lower ones to be seen."""
    time = np.linspace(0.0, 1.0, 50)
    heights = {"a": time, "b": time + 0.01, "c": time - 0.005, "d": 1.0 - time}
    panel = Panel("x", "y", [PlotCurve(name, name, time, values, time) for name, values in heights.items()])
    axes = draw_figure([panel], list(heights)).axes[0]
    styles = [line.get_linestyle() for line in axes.lines]
    assert [style == "-" for style in styles] == [True, False, False, True]
    gaps = [line._unscaled_dash_pattern[1] for line in axes.lines[1:3]]  # type: ignore[attr-defined]
    assert sum(gaps[0]) == sum(gaps[1]) and gaps[1][0] < gaps[0][0]


def test_workbook_has_the_numbers_of_all_curves(recording: Recording, tmp_path: Path) -> None:
    """A sheet for each panel; equal curves as well, and nothing where there is no value."""
    openpyxl = pytest.importorskip("openpyxl", reason="needs the extra 'xlsx'")
    command = ("recording", "plot", recording.path, "-o", tmp_path, "--format", "xlsx")
    assert tiny_run.command(*command).output.endswith(f"{tmp_path / 'plots.xlsx'}\n")
    book = openpyxl.load_workbook(tmp_path / "plots.xlsx")
    assert book.sheetnames == [name for name in PANELS if expected(name, recording) and curves(recording, name)]
    for name in ("pressure", "bending", "tips-side", "step-time"):
        titles, *rows = book[name].iter_rows(values_only=True)
        panel, column = PANELS[name](RunCurves(recording)), -1
        for curve in panel.curves:
            column = titles.index(f"{panel.y_axis}, {curve.label}")
            over = max(number for number in range(column) if titles[number] == panel.x_axis)
            for place, values in ((over, curve.x), (column, curve.y)):
                read = [np.nan if row[place] is None else row[place] for row in rows]
                np.testing.assert_allclose(read, values, rtol=1e-14)
        assert column == len(titles) - 1


def test_workbook_takes_any_name_of_a_signal(recording: Recording) -> None:
    """Such as a formula, a letter that no sheet's name has, control characters, and long ones that begin alike."""
    openpyxl = pytest.importorskip("openpyxl", reason="needs the extra 'xlsx'")
    time, names = np.linspace(0.0, 1.0, 3), ["=1+1", "signal a/b:c", "\x1b[31m", "x" * 40 + "1", "x" * 40 + "2"]
    panels = {name: Panel(TIME_AXIS, f"signal {name}", [PlotCurve(name, "", time, time, time)]) for name in names}
    book = openpyxl.load_workbook(io.BytesIO(files_of(panels, [], "xlsx")[0]))
    assert len(book.sheetnames) == len(names) and all(len(name) <= 31 for name in book.sheetnames)
    assert [cell.value for cell in book.worksheets[0][1]] == [TIME_AXIS, "signal =1+1, =1+1"]
    assert all(cell.data_type == "s" for sheet in book for cell in sheet[1])


def test_legends_hide_no_curve_and_axes_have_units(recording: Recording) -> None:
    run = RunCurves(recording)
    figure = draw_figure(
        [make(run) for name, make in PANELS.items() if expected(name, run.recording)], ["left", "right", "cube"]
    )
    figure.draw_without_rendering()
    for axes in filter(lambda axes: axes.get_visible(), figure.axes):
        assert "[" in axes.get_xlabel() and "[" in axes.get_ylabel()
        legend = axes.get_legend().get_window_extent()
        assert not any(legend.overlaps(others.get_window_extent()) for others in figure.axes)
        assert figure.bbox.x0 <= legend.x0 and legend.x1 <= figure.bbox.x1 and legend.y1 <= figure.bbox.y1


def test_a_single_frame_is_a_dot() -> None:
    one = np.zeros(1)
    axes = draw_figure([Panel("x", "y", [PlotCurve("a", "a", one, one, one)])], ["a"]).axes[0]
    assert axes.lines[0].get_marker() == "."


def test_a_figure_is_plotted_over_another_one_of_the_same_body(
    recording: Recording, observed: list[Observation]
) -> None:
    run = RunCurves(recording)
    panel = against(PANELS["pressure"](run), PANELS["tip-y"](run))
    assert (panel.x_axis, panel.y_axis) == ("pressure [kPa]", "y of the tip [mm]")
    for curve, name in zip(panel.curves, ("left", "right"), strict=True):
        assert (curve.label, curve.body) == (name, name)
        np.testing.assert_allclose(curve.x, [seen.pressures[f"{name}.cavity"] for seen in observed], atol=1e-9)
        np.testing.assert_allclose(curve.y, [seen.tip_positions[name][1] for seen in observed], atol=SINGLE)
    assert b"PNG" in draw_plots(recording, "png", ["bending"], "pressure").files[0][:8]
    with pytest.raises(PlotError, match="--x heat: there are: pressure"):
        draw_plots(recording, "png", ["bending"], "heat")
    with pytest.raises(PlotError, match="tips-side is a path"):
        draw_plots(recording, "png", ["tips-side"], "pressure")


def test_noise_of_the_solver_is_a_line_and_ticks_have_whole_numbers() -> None:
    """1e-8 N around 0, and around a large value: neither fills the panel, nor stands an exponent above it."""
    time = np.linspace(0.0, 1.0, 50)
    for level, unit in ((0.0, "mN"), (1e6, "things")):
        noise = PlotCurve("a", "", time, level + 1e-8 * np.sin(40.0 * time), time)
        figure = draw_figure([Panel(TIME_AXIS, f"force [{unit}]", [noise])], [])
        figure.draw_without_rendering()
        (axes,) = figure.axes
        low, high = axes.get_ylim()
        assert high - low > 1e6 * 1e-8
        assert axes.yaxis.get_offset_text().get_text() == ""
    signal = PlotCurve("a", "", time, np.sin(40.0 * time), time)
    (axes,) = draw_figure([Panel(TIME_AXIS, "force [mN]", [signal])], []).axes
    assert axes.get_ylim()[1] < 1.2


def test_a_body_has_one_colour_in_all_panels(recording: Recording) -> None:
    run = RunCurves(recording)
    bending, forces = draw_figure([PANELS[name](run) for name in ("bending", "normal-force")], ["left", "right"]).axes
    colour = {line.get_label(): line.get_color() for line in (*bending.lines, *forces.lines)}
    assert colour["left"] == colour["left|cube"] != colour["right"] == colour["right|cube"]


def test_the_command_writes_png_and_svg(run: tuple[Path, list[Observation]], tmp_path: Path) -> None:
    shown = tiny_run.command("recording", "plot", run[0], "-o", tmp_path, "--only", "bending")
    assert shown.output.split() == [str(tmp_path / "plots.png")]
    assert (tmp_path / "plots.png").read_bytes().startswith(b"\x89PNG")
    tiny_run.command("recording", "plot", run[0], "-o", tmp_path, "--format", "svg", "--only", "pressure, slip")
    assert {"pressure [kPa]", "slip against the fingers [mm]"} == axes_of(tmp_path / "plots.svg")


def test_panels_without_anything_to_show_are_named_and_the_rest_drawn(tmp_path: Path) -> None:
    """The made-up finger is not held and the base has not moved yet: no tip, and no slip."""
    fake_run.fake_run([RecordingOutput(tmp_path)], steps=3)
    shown = tiny_run.command("recording", "plot", tmp_path / "recording.h5", "--format", "svg")
    assert "no plot of slip: nothing of the kind in this run\n" in shown.output
    assert "no plot of bending: nothing of the kind in this run\n" in shown.output
    assert {"pressure [kPa]", "normal force [mN]", "risen by [mm]"} < axes_of(tmp_path / "plots.svg")
    with (
        read_recording(tmp_path / "recording.h5") as recording,
        pytest.raises(PlotError, match="nothing to plot: this run has nothing of slip"),
    ):
        draw_plots(recording, "svg", ["slip"])


def test_unknown_names_are_refused_with_the_known_ones(recording: Recording) -> None:
    with pytest.raises(
        PlotError, match="--only pressures: there are: pressure, volume, air_mass, air_flow, valve, tension"
    ):
        draw_plots(recording, "png", ["pressures"])
    with pytest.raises(PlotError, match="--format pdf: there are: png, svg, csv, xlsx"):
        draw_plots(recording, "pdf")


def test_the_stretch_is_that_of_the_recorded_positions(recording: Recording) -> None:
    """The largest singular value of any element's deformation, frame by frame."""
    panel = PANELS["stretch"](RunCurves(recording))
    assert [curve.label for curve in panel.curves] == [body.name for body in recording.soft_bodies]
    frame = len(recording.times) - 1
    for curve, body in zip(panel.curves, recording.soft_bodies, strict=True):
        position = recording.row("position", frame)[body.nodes]
        rest, now = (
            np.swapaxes(x[body.elements[:, 1:]] - x[body.elements[:, :1]], 1, 2) for x in (body.rest_position, position)
        )
        largest = np.linalg.svd(now @ np.linalg.inv(rest))[1].max()
        assert curve.y[-1] == pytest.approx(largest, rel=1e-7)
        assert largest > 1.001
