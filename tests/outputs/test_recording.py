"""A recording gives back what was computed."""

import platform
from importlib.metadata import version
from pathlib import Path

import fake_run
import numpy as np
import pytest

from taichisoft.scene import scene_to_toml
from taichisoft_outputs import RecordingError, read_recording
from taichisoft_outputs.recording.recording_output import RecordingOutput

STEPS = 113


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recording")
    fake_run.fake_run([RecordingOutput(folder)], steps=STEPS, floor=True)
    with read_recording(folder / "recording.h5") as opened:
        yield opened


def test_every_number_of_every_frame_comes_back(recording):
    assert recording.frame_count == STEPS + 1
    for frame in range(STEPS + 1):
        fake_run.check_frame(recording, frame, frame)
    assert np.array_equal(recording.column("iterations"), np.arange(STEPS + 1))
    assert np.array_equal(recording.column("converged")[1:], np.arange(1, STEPS + 1) % 2 == 0)


def test_every_tenth_step_and_the_last_one_have_a_state_in_double_precision(recording):
    with_state = [frame for frame in range(STEPS + 1) if recording.has_state(frame)]
    assert with_state == [*range(0, STEPS + 1, 10), STEPS]
    with pytest.raises(RecordingError, match="frame 7 has no state of its own"):
        recording.state(7)


def test_velocities_between_states_are_those_of_the_way_since_the_frame_before(recording):
    assert np.array_equal(recording.velocity(20), fake_run.fake_state(20).velocity)
    assert np.allclose(recording.velocity(22), [[1.0 / fake_run.STEP, 0.0, 0.0]] * 4, atol=2e-3)


def test_meshes_and_materials_come_back(recording):
    (finger,) = recording.soft_bodies
    assert (finger.name, finger.nodes) == ("finger", slice(0, 4))
    assert np.array_equal(finger.rest_position, fake_run.REST) and finger.elements.tolist() == [[0, 1, 2, 3]]
    assert recording.materials == ["finger"] and recording.row("young_modulus", 7).tolist() == [507.0]
    assert finger.material.tolist() == [0] and np.allclose(finger.poisson_ratio, 0.3, rtol=1e-14)
    assert np.array_equal(finger.surface_groups["outer"], fake_run.FACES)
    assert finger.element_groups["tip"].tolist() == [0]
    assert np.array_equal(finger.mesh("a").nodes, fake_run.REST)


def test_pressures_and_forces_stand_in_named_columns_whatever_the_order_of_a_pair(recording):
    cavity, pair = recording.cavities.index("finger.cavity"), recording.pairs.index(("finger", "cube"))
    assert recording.row("pressure", 7)[cavity] == 14.0
    assert recording.row("volume", 7)[cavity] == 107.0
    assert recording.row("normal_force", 7)[pair] == 21.0  # reported as "cube|finger"
    assert recording.row("friction_force", 7)[pair] == 7.0
    assert recording.row("slip_speed", 7)[pair] == 3.5
    assert recording.row("pressure", 0)[cavity] == 0.0


@pytest.mark.parametrize("frame", [0, 1, 2, 3, 50, 51, 62, 63])
def test_contacts_of_a_frame(recording, frame):
    points, forces = recording.contacts(frame)
    assert np.array_equal(points, np.full((frame % 3, 3), float(frame)))
    assert np.array_equal(forces, fake_run.fake_report(frame).contact_forces)
    assert recording.contact_pairs(frame) == [("finger", "cube")] * (frame % 3)


def test_header(recording):
    assert recording.outcome == "completed"
    assert recording.step_size == fake_run.STEP
    assert recording.scene_text == scene_to_toml(fake_run.fake_model().scene)
    assert recording.scene == fake_run.fake_model().scene
    assert [plane.name for plane in recording.planes] == ["floor"]
    assert recording.versions["taichi"] == version("taichi")
    assert recording.versions["machine"].startswith(platform.system())


def test_surfaces_follow_their_bodies(recording):
    surfaces = {surface.name: surface for surface in recording.surfaces}
    assert {name: surface.kind for name, surface in surfaces.items()} == {
        "finger": "soft",
        "finger.cavity": "cavity",
        "cube": "rigid",
    }
    lift = np.array([15.0, 0.0, 0.0])
    assert np.array_equal(surfaces["finger"].vertices(20), fake_run.REST + lift)
    shrunk = fake_run.REST.mean(axis=0) + 0.7 * (fake_run.REST - fake_run.REST.mean(axis=0))
    assert np.allclose(surfaces["finger.cavity"].vertices(20), shrunk + lift, atol=1e-12)
    # A turn of 2 * 0.2 rad about x takes y to (0, cos, sin).
    corner = fake_run.CUBE[3]
    c, s = np.cos(0.4), np.sin(0.4)
    turned = [corner[0], c * corner[1] - s * corner[2], s * corner[1] + c * corner[2]]
    assert np.allclose(surfaces["cube"].vertices(20)[3], turned + lift + [0, 30, 30], atol=1e-12)


def test_a_moment_is_found_and_one_outside_the_run_is_an_error(recording):
    assert recording.frame_at(0.204) == 20
    with pytest.raises(RecordingError, match=r"nothing at 9 s; .* from 0 s to 1\.13 s"):
        recording.frame_at(9.0)


def test_what_is_no_recording_is_an_error_of_one_line(tmp_path):
    import h5py

    text, empty = tmp_path / "text.h5", tmp_path / "empty.h5"
    text.write_text("no HDF5")
    h5py.File(empty, "w").close()
    cases = [
        (tmp_path / "no.h5", "no such recording"),
        (text, "not readable as HDF5"),
        (empty, "not a recording"),
    ]
    for path, message in cases:
        with pytest.raises(RecordingError, match=message) as caught:
            read_recording(path)
        assert "\n" not in str(caught.value) and str(path) in str(caught.value)


def test_a_folder_that_cannot_be_written_is_an_error(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(RecordingError, match="cannot be written"):
        RecordingOutput(Path(tmp_path / "file")).begin(fake_run.fake_model(), fake_run.fake_state(0))


def test_a_run_that_is_started_anew_goes_on_in_the_same_recording(tmp_path):
    writer = RecordingOutput(tmp_path)
    writer.begin(fake_run.fake_model(), fake_run.fake_state(0))
    for step in (1, 2, 3):
        writer.record(fake_run.fake_state(step), fake_run.fake_report(step))
    writer.restart(fake_run.fake_state(0))
    for step in (1, 2):
        writer.record(fake_run.fake_state(step), fake_run.fake_report(step))
    writer.end("completed")
    with read_recording(tmp_path / "recording.h5") as recording:
        assert recording.column("step").tolist() == [0, 1, 2, 3, 0, 1, 2]
        assert recording.last_start == 4
        assert recording.frame_at(fake_run.STEP) == 5, "that of the last start"
        with pytest.raises(RecordingError, match=r"nothing at 0\.2 s"):
            recording.frame_at(20 * fake_run.STEP)
