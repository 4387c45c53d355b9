"""Colours, arrows and captions say what was recorded."""

from types import SimpleNamespace

import bent_gripper
import fake_run
import numpy as np
import pytest
from PIL import Image

from taichisoft.base.rotations import rotation_from_degrees
from taichisoft.mechanics import ActuatorNames
from taichisoft.mesh import SectionPlane, read_surface, write_stl
from taichisoft_outputs import Style, read_recording
from taichisoft_outputs.drawing.colouring import (
    PLAIN,
    Colouring,
    at_vertices,
    displacement,
    strain,
    stress,
    with_visual_surfaces,
)
from taichisoft_outputs.drawing.overlay import caption_parts, paint_caption
from taichisoft_outputs.drawing.painting import AIR, SOFT, ColourScale, ForceArrows, round_up
from taichisoft_outputs.drawing.style import StyleError
from taichisoft_outputs.drawing.surface_painter import refuse_what_cuts_nothing
from taichisoft_outputs.recording.recording_output import RecordingOutput

FRAMES = (0, 1, 2)


@pytest.fixture(scope="module")
def gripper(tmp_path_factory):
    with read_recording(bent_gripper.record_gripper(tmp_path_factory.mktemp("gripper"))) as recording:
        yield recording


def test_displacement_is_relative_to_the_moved_base(gripper):
    values = displacement(gripper)
    for body in gripper.soft_bodies:
        assert np.allclose(values(0)[body.nodes], 0.0, atol=1e-9)
        anchored = body.mesh_nodes[:, 0] > -1e-9
        lifted = values(2)[body.nodes]
        assert np.allclose(lifted[anchored], 0.0, atol=1e-9), "the base has risen by 25 mm, with them"
        tip = np.argmin(body.mesh_nodes[:, 0])
        angle, nodes = bent_gripper.FRAMES[2][0], body.mesh_nodes
        assert lifted[tip] == pytest.approx(np.linalg.norm(bent_gripper.bent(nodes, angle)[tip] - nodes[tip]))


def test_displacement_follows_a_base_that_turns(tmp_path):
    model = bent_gripper.gripper_model()
    output = RecordingOutput(tmp_path)
    state = bent_gripper.gripper_state(model, 0)
    # A quarter of a turn about x, about the mean of the anchored nodes (y = 70 or so, z = 0).
    rest = state.position
    (pivot,) = model.frames.pivot
    turn = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    state.position = (rest - pivot) @ turn.T + pivot
    state.frame_pose = np.array([[[0.0, 0.0, 0.0], [np.pi / 2, 0.0, 0.0]]])
    output.begin(model, state)
    output.end("completed")
    with read_recording(output.path) as recording:
        assert displacement(recording)(0).max() < 1e-9


def test_stress_is_highest_where_fibres_are_longest(gripper):
    values = stress(gripper)
    body = gripper.soft_bodies[0]
    assert np.allclose(values(0)[body.nodes], 0.0, atol=1e-6)
    bent = values(1)[body.nodes]
    middle = np.abs(body.mesh_nodes[:, 0] + 60.0) < 30.0
    outer = bent[middle & (body.mesh_nodes[:, 1] < 2.0)].mean()
    inner = bent[middle & (body.mesh_nodes[:, 1] > 28.0)].mean()
    # Outer fibres are strained by 0.45 * 30 / 115 and keep their width: von Mises' stress is E / (1 + nu) times that.
    # The elements at the outer side reach a few millimetres inwards.
    assert outer == pytest.approx(500.0 / 1.3 * 0.45 * 30.0 / 115.0, rel=0.1)
    assert inner < 0.5 * outer


def test_strain_is_that_of_the_longest_fibres(gripper):
    """0.45 * 30 / 115 at the outer side, nothing at rest; elements at the outer side reach some mm inwards."""
    values = strain(gripper)
    body = gripper.soft_bodies[0]
    assert np.allclose(values(0)[body.nodes], 0.0, atol=1e-7)
    middle = np.abs(body.mesh_nodes[:, 0] + 60.0) < 30.0
    outer = values(1)[body.nodes][middle & (body.mesh_nodes[:, 1] < 2.0)].mean()
    assert outer == pytest.approx(0.45 * 30.0 / 115.0, rel=0.1)


@pytest.mark.parametrize(
    ("style", "opacity", "scales"),
    [
        (Style(colour_by="stress"), 1.0, ["von Mises stress [kPa]"]),
        (Style(colour_by="strain"), 1.0, ["largest strain [-]"]),
        (Style(colour_by="strain", opacity=0.5), 0.5, ["largest strain [-]", "pressure [kPa]"]),
        (Style(colour_by="displacement"), 1.0, ["displacement [mm]"]),
        (Style(colour_by="displacement", section="z=0"), 1.0, ["displacement [mm]", "pressure [kPa]"]),
    ],
)
def test_values_are_drawn_opaque_unless_asked_otherwise(gripper, style, opacity, scales):
    """Cavities that shine through would change the colours of the bar; in a section they are seen beside them."""
    assert style.soft_opacity == opacity
    assert [scale.title for scale in Colouring(gripper, style, FRAMES, gripper.surfaces).scales] == scales


def test_colours_mean_what_the_bars_say(gripper):
    colouring = Colouring(gripper, Style(colour_by="displacement", section="z=0"), FRAMES, gripper.surfaces)
    first, second = colouring.scales
    assert (first.title, second.title) == ("displacement [mm]", "pressure [kPa]")
    assert (second.low, second.high) == (0.0, 50.0)
    soft, cavity = gripper.surfaces[:2]
    assert np.allclose(first.colours(colouring.values(0)), SOFT[0])
    tips = soft.vertices(0)[:, 0] < -114.0
    at_tips = at_vertices(soft.mapping, colouring.values(2))[tips]
    assert (first.colours(at_tips)[:, 1] < 0.4).all(), "violet"
    assert (first.high, first.top) == (
        first.high,
        f">= {first.high:g}" if first.highest > first.high else f"{first.high:g}",
    )
    assert np.allclose(colouring.colours(0)[cavity.name], AIR[0])
    assert np.allclose(colouring.colours(2)[cavity.name], AIR[-1])
    cube = next(surface for surface in gripper.surfaces if surface.kind == "rigid")
    assert tuple(colouring.colours(2)[cube.name]) == PLAIN["rigid"]


def test_there_is_no_bar_for_what_cannot_be_seen(gripper, tmp_path):
    for style in (Style(cavity_pressure=False), Style(opacity=1.0)):
        assert Colouring(gripper, style, FRAMES, gripper.surfaces).scales == ()
    fake_run.fake_run([RecordingOutput(tmp_path)], steps=0)
    with read_recording(tmp_path / "recording.h5") as start:  # without any pressure or contact
        assert Colouring(start, Style(), [0], start.surfaces).scales == ()
        assert caption_parts(start, 0) == ["0.00 s", "pressure 0.0 kPa", "cube raised 0.0 mm"]
        ForceArrows(start, [0], 10.0).paint(None, None, 0, None)  # would fail if it tried to paint


def test_a_colour_scale_is_linear_and_holds_its_ends():
    scale = ColourScale("x", -10.0, 10.0, ((0.0, 0.0, 0.0), (0.5, 1.0, 0.0), (1.0, 0.0, 0.0)))
    colours = scale.colours(np.array([-20.0, -10.0, -5.0, 0.0, 10.0, 99.0]))
    expected = [[0, 0, 0], [0, 0, 0], [0.25, 0.5, 0], [0.5, 1, 0], [1, 0, 0], [1, 0, 0]]
    assert np.allclose(colours, expected)
    values = (0.7, 1.0, 1.1, 2.2, 101.0, 130.0, 500.0, 501.0)
    assert [round_up(value) for value in values] == [0.7, 1, 1.2, 2.5, 120, 150, 500, 600]


def test_the_caption_has_time_pressure_and_height(gripper):
    assert caption_parts(gripper, 0) == ["0.00 s", "pressure 0.0 kPa", "cube raised 0.0 mm"]
    assert caption_parts(gripper, 2) == ["0.02 s", "pressure 50.0 kPa", "cube raised 25.0 mm"]


@pytest.mark.parametrize(
    ("pressures", "text"),
    [
        ([20.0, -0.01], "pressures 20.0, 0.0 kPa"),
        ([1.0, 2.0, 3.0, 4.0, 5.0], "pressures from 1.0 to 5.0 kPa"),
    ],
)
def test_different_pressures_are_all_in_the_caption(pressures, text):
    rows = {"pressure": np.array(pressures), "rigid_position": np.zeros((0, 3))}
    actuators = ActuatorNames({"cavity": [f"cavity {number}" for number in range(len(pressures))], "cable": ()})
    recording = SimpleNamespace(
        times=np.zeros(3), actuators=actuators, row=lambda name, frame: rows[name], last_start=0,
        scene=SimpleNamespace(rigid_bodies=(), objects=(), up=np.array([0.0, 0.0, 1.0])),
    )  # fmt: skip
    assert caption_parts(recording, 1) == ["0.00 s", text]


def test_a_caption_that_is_too_long_goes_on_in_the_next_line():
    heights = []
    for width in (800, 160):
        picture = Image.new("RGB", (width, 200), "white")
        paint_caption(picture, ["1.00 s", "pressure 50.0 kPa", "cube raised 25.0 mm"], (0.0, 0.0, 0.0), 7.0)
        rows, columns = np.nonzero(np.asarray(picture)[..., 0] < 128)
        assert columns.max() < width - 3
        heights.append(rows.max())
    assert heights[1] > heights[0] + 7


def test_twice_the_force_is_twice_the_arrow(gripper):
    from taichisoft_outputs.drawing.camera import fit_camera

    camera = fit_camera(gripper.surfaces[0].vertices(0), gripper.scene.up, "front", 16 / 9)
    lengths = []
    for radius in (50.0, 100.0):
        picture = Image.new("RGB", (640, 360))
        ForceArrows(gripper, FRAMES, radius).paint_scale(picture, camera, (0.0, 0.0, 0.0), 9.0)
        lengths.append(np.ptp(np.nonzero(np.asarray(picture).any(axis=2))[1]))
    assert lengths[1] == pytest.approx(2 * lengths[0], abs=2)


def test_a_force_on_what_is_cut_off_has_no_arrow(gripper):
    """The camera looks along -x at what is left of x < 1000 or x < -1000 mm, which is all or nothing."""
    from taichisoft_outputs.drawing.camera import PictureCamera

    points, forces = gripper.contacts(2)
    middle = points.mean(axis=0)
    camera = PictureCamera(middle + np.array([2000.0, 0.0, 0.0]), middle, np.array([0.0, 0.0, 1.0]))
    assert np.linalg.norm(forces[:, 1:], axis=1).max() > 0.0, "across the view"
    painted = []
    for section in (None, "x<1000", "x<-1000"):
        picture, plane = Image.new("RGB", (64, 36)), SectionPlane.parse(section) if section else None
        ForceArrows(gripper, FRAMES, 500.0).paint(picture, camera, 2, plane)
        painted.append(int(np.asarray(picture).any(axis=2).sum()))
    assert painted[0] == painted[1] > 0 == painted[2]


def test_a_finer_surface_moves_with_the_elements(gripper, tmp_path):
    body = gripper.soft_bodies[1]
    low, high = np.array([-110.0, 15.0, -9.0]), np.array([-101.0, 29.0, 9.0])  # the tip of the finger
    box = fake_run.CUBE / 10.0 * (high - low) + (low + high) / 2
    path = tmp_path / "box.stl"
    write_stl(box, fake_run.CUBE_FACES, path)
    surfaces = with_visual_surfaces(gripper, path)
    finer = next(surface for surface in surfaces if surface.name == body.name)
    assert len(finer.triangles) == 12
    angle, _, height = bent_gripper.FRAMES[2]
    settings = bent_gripper.gripper_model().soft_bodies[1].settings
    turn = rotation_from_degrees(settings.rotation)
    exact = (
        bent_gripper.bent(read_surface(path)[0], angle) @ turn.T + np.array(settings.translation) + [height, 0.0, 0.0]
    )
    assert np.linalg.norm(finer.vertices(2) - exact, axis=1).max() < 0.2, "up to the bend in an element"
    assert [surface.name for surface in surfaces] == [surface.name for surface in gripper.surfaces]


def test_a_surface_elsewhere_is_refused(gripper, tmp_path):
    path = tmp_path / "elsewhere.stl"
    write_stl(fake_run.CUBE + 1000.0, fake_run.CUBE_FACES, path)
    with pytest.raises(StyleError, match="8 of 8 vertices lie further from the mesh of 'finger1'"):
        with_visual_surfaces(gripper, path)
    with pytest.raises(
        StyleError, match=r"no body is called 'ball'; there are: finger1, finger2, finger3, cube, and NAME\.tip"
    ):
        Style(view="follow:ball").check(gripper.scene)
    Style(view="follow:cube").check(gripper.scene)
    Style(view="follow:finger1.tip").check(gripper.scene)


def test_a_plane_that_cuts_nothing_is_refused():
    points = np.array([[0.0, 0.0, 0.0], [10.0, 20.0, 30.0]])
    refuse_what_cuts_nothing("x+y<15", points)
    spans = r"what is drawn spans \[0.0, 0.0, 0.0\] to \[10.0, 20.0, 30.0\] mm"
    with pytest.raises(StyleError, match=f"section 'y=500' cuts nothing; {spans}"):
        refuse_what_cuts_nothing("y=500", points)
