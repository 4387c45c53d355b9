"""The controller's signals come back from the recording, and plots and report show them."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import fake_run
import numpy as np
import pytest
from tiny_run import make_run

from taichisoft import Control, Simulation, load_scene
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft_outputs import read_recording
from taichisoft_outputs.plots import PlotError, draw_plots
from taichisoft_outputs.recording.layout import SIGNAL_COUNT
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.report import collect, report_page

SIGNALS = [{"phase": 1.0}, {"phase": 2.0, "$late$ <b>": 7.5}, {}, {"phase": 3.0}]


def record(folder: Path, signals: Sequence[Mapping[str, float]]) -> Path:
    """A made-up run with these signals in its steps; one frame each."""
    output = fake_run.begun(RecordingOutput(folder))
    for step, values in enumerate(signals, start=1):
        report = fake_run.fake_report(step)
        report.signals = values
        output.record(fake_run.fake_state(step), report)
    output.end("completed")
    return output.path


@pytest.mark.parametrize("repaired", [False, True])
def test_signals_come_back_also_one_that_comes_late(tmp_path: Path, repaired: bool) -> None:
    """NaN stands where the controller gave nothing, and before the first step."""
    path = record(tmp_path, SIGNALS)
    if repaired:
        with read_recording(path) as recording:
            recording.rescue(path := tmp_path / "new.h5")
    with read_recording(path) as recording:
        assert recording.signals == ["phase", "$late$ <b>"]
        none = np.nan
        np.testing.assert_array_equal(recording.column("signals")[:, 0], [none, 1.0, 2.0, none, 3.0])
        np.testing.assert_array_equal(recording.column("signals")[:, 1], [none, none, 7.5, none, none])


def test_plots_have_a_panel_for_each_signal(tmp_path: Path) -> None:
    with read_recording(record(tmp_path, SIGNALS)) as recording:
        plots = draw_plots(recording, "svg")
        assert {"signal phase", "signal $late$ <b>"} < set(plots.shown)
        assert draw_plots(recording, "svg", ["signal phase"]).shown == ("signal phase",)
        with pytest.raises(PlotError, match=r"--only signal place: there are: .*, signal phase, "):
            draw_plots(recording, "svg", ["signal place"])


def test_the_report_has_a_table_of_the_signals(tmp_path: Path) -> None:
    with read_recording(record(tmp_path, SIGNALS)) as recording:
        page = report_page(collect(recording), tmp_path)
    assert "<th>phase</th><td>3 at last, from 1 to 3</td>" in page
    assert "<th>$late$ &lt;b&gt;</th>" in page
    with read_recording(record(tmp_path, [{}])) as recording:
        assert "Signals of the controller" not in report_page(collect(recording), tmp_path)


def test_signals_beyond_the_room_are_named_once(tmp_path: Path) -> None:
    many = {f"signal {number}": float(number) for number in range(SIGNAL_COUNT + 1)}
    with pytest.warns(UserWarning, match=f"room for {SIGNAL_COUNT} .*'signal {SIGNAL_COUNT}' is left") as warned:
        path = record(tmp_path, [many, many])
    assert len(warned) == 1
    with read_recording(path) as recording:
        assert recording.signals == list(many)[:SIGNAL_COUNT]


def test_the_signals_of_a_real_run(tmp_path: Path) -> None:
    controls = [Control(signals={"set point": 10.0 * step}) for step in range(4)]
    make_run(Simulation(load_scene(TINY_GRIPPER)), [RecordingOutput(tmp_path, every=2)], controls)
    with read_recording(tmp_path / "recording.h5") as recording:
        np.testing.assert_array_equal(recording.column("signals")[:, 0], [np.nan, 10.0, 30.0])
