"""Recording every N-th step, and packed; files of another layout are refused."""

import fake_run
import pytest

from taichisoft_outputs import RecordingError, read_recording
from taichisoft_outputs.recording import bodies
from taichisoft_outputs.recording.layout import LAYOUT
from taichisoft_outputs.recording.recording_output import RecordingOutput


def record(folder, steps, **settings):
    fake_run.fake_run([RecordingOutput(folder, **settings)], steps)
    return read_recording(folder / "recording.h5")


def test_every_nth_step_and_the_last_one_are_frames(tmp_path):
    with record(tmp_path, steps=17, every=5) as recording:
        assert recording.every == 5
        assert recording.column("step").tolist() == [0, 5, 10, 15, 17]
        for frame, step in enumerate((0, 5, 10, 15, 17)):
            fake_run.check_frame(recording, frame, step)
        assert recording.frame_at(0.1) == 2 and recording.frame_at(0.16) == 3


def test_figures_of_the_solver_are_the_worst_since_the_frame_before(tmp_path):
    reports = [fake_run.fake_report(step) for step in range(1, 7)]
    for report, iterations, converged, seconds in zip(
        reports, (3, 90, 4, 5, 6, 7), (True, False, True, True, True, True), (1, 2, 6, 1, 1, 1), strict=True
    ):
        report.iterations, report.converged, report.step_time = iterations, converged, seconds
        report.residual, report.max_penetration = iterations * 1e-7, iterations * 1e-3
    output = RecordingOutput(tmp_path, every=3)
    output.begin(fake_run.fake_model(), fake_run.fake_state(0))
    for step, report in enumerate(reports, start=1):
        output.record(fake_run.fake_state(step), report)
    output.end("completed")
    with read_recording(tmp_path / "recording.h5") as recording:
        assert recording.column("iterations").tolist() == [0, 90, 7]
        assert recording.column("converged").tolist() == [True, False, True]
        assert recording.column("residual").tolist() == [0.0, 90 * 1e-7, 7 * 1e-7]
        assert recording.column("max_penetration").tolist() == [0.0, 90 * 1e-3, 7 * 1e-3]
        assert recording.column("step_time").tolist() == [0.0, 3.0, 1.0], "their mean"


def test_a_run_started_anew_has_the_last_step_before_it_as_a_frame(tmp_path):
    output = RecordingOutput(tmp_path, every=4)
    output.begin(fake_run.fake_model(), fake_run.fake_state(0))
    for step in range(1, 7):
        output.record(fake_run.fake_state(step), fake_run.fake_report(step))
    output.restart(fake_run.fake_state(0))
    for step in range(1, 5):
        output.record(fake_run.fake_state(step), fake_run.fake_report(step))
    output.end("completed")
    with read_recording(tmp_path / "recording.h5") as recording:
        assert recording.column("step").tolist() == [0, 4, 6, 0, 4]


def test_what_cannot_be_recorded_is_an_error_before_the_run(tmp_path):
    with pytest.raises(RecordingError, match="--every 0: must be at least 1"):
        RecordingOutput(tmp_path, every=0)


def test_a_quantity_that_is_not_recorded_is_named_beside_those_that_are(tmp_path):
    with (
        record(tmp_path, steps=2) as recording,
        pytest.raises(RecordingError, match=r"no .presure.; there are: .*time"),
    ):
        recording.column("presure")


@pytest.mark.parametrize("ended", [True, False])
def test_a_recording_of_another_layout_is_told_from_a_damaged_one(tmp_path, monkeypatch, ended):
    """Whatever begins like a recording of today: versions before this one took it for damaged."""
    monkeypatch.setattr(bodies, "LAYOUT", LAYOUT - 1)
    output = RecordingOutput(tmp_path)
    output.begin(fake_run.fake_model(), fake_run.fake_state(0))
    output.record(fake_run.fake_state(1), fake_run.fake_report(1))
    if ended:
        output.end("completed")
    with pytest.raises(RecordingError, match=rf"wrote it in layout {LAYOUT - 1}, this version reads layout {LAYOUT};"):
        read_recording(tmp_path / "recording.h5")


@pytest.mark.parametrize(("layout", "shown"), [(LAYOUT - 1, LAYOUT - 1), (LAYOUT + 1, LAYOUT + 1), (None, "none")])
def test_a_file_of_another_layout_is_refused_with_one_line(tmp_path, layout, shown):
    import h5py

    with h5py.File(tmp_path / "recording.h5", "w") as file:
        file.attrs["taichisoft_version"] = "0.1"
        if layout is not None:
            file.attrs["layout"] = layout
    expected = rf"recording\.h5: taichisoft [\d.]+ wrote it in layout {shown}, this version reads layout {LAYOUT}; run"
    with pytest.raises(RecordingError, match=expected) as caught:
        read_recording(tmp_path / "recording.h5")
    assert "\n" not in str(caught.value)
