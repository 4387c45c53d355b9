"""Recording less: every N-th step, some fields; what was left out is named, and nothing is lost in silence."""

import fake_run
import numpy as np
import pytest

from taichisoft.state import State
from taichisoft_plugins.recording.layout import FIELDS, RecordingError
from taichisoft_plugins.recording.output import RecordingOutput
from taichisoft_plugins.recording.reader import read_recording


def record(folder, steps, **settings):
    fake_run.fake_run([RecordingOutput(folder, **settings)], steps)
    return read_recording(folder / "recording.h5")


def test_every_nth_step_and_the_last_one_are_frames(tmp_path):
    with record(tmp_path, steps=17, every=5) as recording:
        assert recording.every == 5
        assert recording.column("step").tolist() == [0, 5, 10, 15, 17]
        for frame, step in enumerate((0, 5, 10, 15, 17)):
            assert recording.state(frame) == State(**vars(fake_run.fake_state(step)))
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


def test_what_the_fields_leave_out_is_named_when_it_is_asked_for(tmp_path):
    with record(tmp_path, steps=3, fields="forces, contacts") as recording:
        assert recording.fields == ("contacts", "forces")
        assert recording.has("normal_force") and recording.has("rigid_position") and not recording.has("position")
        assert len(recording.contacts(2)[0]) == 2
        cube = next(surface for surface in recording.surfaces if surface.kind == "rigid")
        assert cube.vertices(3).shape == (8, 3), "rigid poses are always recorded"
        for name in ("position", "pressure"):
            with pytest.raises(
                RecordingError, match=f"no steps/{name}: --fields contacts,forces left it out"
            ) as caught:
                recording.column(name)
            assert str(tmp_path) in str(caught.value) and "\n" not in str(caught.value)
        with pytest.raises(RecordingError, match="no 'presure'; there are: "):
            recording.column("presure")
        with pytest.raises(RecordingError, match=r"left out positions, velocities, cavities, controls$"):
            recording.state(1)


@pytest.mark.parametrize("field", FIELDS)
def test_each_field_can_be_recorded_alone(tmp_path, field):
    with record(tmp_path, steps=5, fields=field) as recording:
        assert recording.frame_count == 6
        assert np.array_equal(recording.times, 0.01 * np.arange(6))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"every": 0}, "--every 0: must be at least 1"),
        ({"fields": "positions,force"}, "--fields positions,force: no field is called 'force'; there are: positions, "),
        ({"fields": " , "}, "names no field"),
    ],
)
def test_what_cannot_be_recorded_is_an_error_before_the_run(tmp_path, settings, message):
    with pytest.raises(RecordingError, match=message):
        RecordingOutput(tmp_path, **settings)


def test_a_packed_recording_has_the_same_numbers(tmp_path, monkeypatch):
    import h5py

    monkeypatch.setattr("taichisoft_plugins.recording.file.LARGE", 12)  # as many as the made-up body has
    record(tmp_path / "plain", steps=70).__exit__()
    with record(tmp_path, steps=70, compress=True) as recording:
        assert all(recording.state(frame) == State(**vars(fake_run.fake_state(frame))) for frame in (0, 33, 70))
    with h5py.File(tmp_path / "recording.h5") as packed, h5py.File(tmp_path / "plain" / "recording.h5") as plain:
        assert packed["steps/position"].compression == "gzip" and plain["steps/position"].compression is None


def test_a_file_of_an_older_version_says_so(tmp_path):
    import h5py

    record(tmp_path, steps=2).__exit__()
    with h5py.File(tmp_path / "recording.h5", "r+") as file:
        del file["soft_bodies/0/young_modulus"], file["steps/cavity_target"], file["frames"], file.attrs["layout"]
    with read_recording(tmp_path / "recording.h5") as recording:
        assert recording.frame_count == 3 and len(recording.surfaces) == 3
        for ask in (lambda: recording.soft_bodies, lambda: recording.state(1)):
            with pytest.raises(RecordingError, match=r"taichisoft [\d.]+ wrote it in layout 1, this version reads 2"):
                ask()
