"""Colours, arrows and captions tell what was recorded, with the colours and the background that the scene gives."""

import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import bent_gripper
import fake_run
import numpy as np
import pytest
from PIL import Image

from taichisoft import Scene, load_scene
from taichisoft.base import matrices_from_quaternions
from taichisoft.base.rotations import rotation_from_degrees
from taichisoft.mechanics import ActuatorNames, BodySurface, Plane, axes_of_bodies
from taichisoft.mechanics.body_geometry import RigidAxes
from taichisoft.mesh import MappedSurface, SectionPlane, read_surface, write_stl
from taichisoft.scene import scene_from_toml, scene_to_toml
from taichisoft.scene.scene import Appearance
from taichisoft_outputs import Recording, Style, read_recording, render_pictures
from taichisoft_outputs.drawing.camera import fit_camera, scene_axes
from taichisoft_outputs.drawing.colouring import (
    AIR,
    NAMED,
    PLAIN,
    SOFT,
    Colouring,
    ColourScale,
    at_corners,
    body_colours,
    displacement,
    displacements,
    round_up,
    strain,
    stress,
    with_visual_surfaces,
)
from taichisoft_outputs.drawing.overlay import (
    FORCE_COLOURS,
    ON_DARK,
    arrow_colour,
    as_bytes,
    caption_parts,
    displacement_arrows,
    force_arrows,
    paint_caption,
)
from taichisoft_outputs.drawing.stage import Floor
from taichisoft_outputs.drawing.style import BACKGROUND, StyleError
from taichisoft_outputs.drawing.surface_painter import key_light, refuse_what_cuts_nothing, shade
from taichisoft_outputs.recording.bodies import RecordedSurface
from taichisoft_outputs.recording.recording_file import write_texts
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.web.page import FLOOR as PLAIN_FLOOR
from taichisoft_outputs.web.page import SceneView
from taichisoft_outputs.web.page_messages import PageInstant, PageScene, ShownPoses

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
        assert lifted[tip, 0] == pytest.approx(np.linalg.norm(bent_gripper.bent(nodes, angle)[tip] - nodes[tip]))


def test_triangle_has_the_values_of_its_own_material() -> None:
    """Of three nodes the middle one lies between materials of 1 and of 9 kPa."""
    mapping = MappedSurface(np.arange(4)[:, None], np.ones((4, 1)), np.array([[0, 1, 1], [1, 2, 2], [0, 1, 2]]))
    surface = RecordedSurface("finger", "soft", mapping.triangles, lambda instant: np.zeros((4, 3)), mapping)
    values = np.array([[1.0, np.nan], [1.0, 9.0], [np.nan, 9.0], [1.0, np.nan]])
    assert at_corners(surface, values).tolist() == [1.0, 1.0, 1.0, 9.0, 9.0, 9.0, 1.0, 1.0, 9.0]


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
    assert np.allclose(np.nanmax(values(0)[body.nodes], axis=1), 0.0, atol=1e-6)
    bent = np.nanmin(values(1)[body.nodes], axis=1)
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
    assert np.allclose(np.nanmax(values(0)[body.nodes], axis=1), 0.0, atol=1e-7)
    middle = np.abs(body.mesh_nodes[:, 0] + 60.0) < 30.0
    outer = np.nanmin(values(1)[body.nodes][middle & (body.mesh_nodes[:, 1] < 2.0)], axis=1).mean()
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


def test_range_and_map_are_those_chosen(gripper):
    """The ends and the middle of viridis; values beyond an end have its colour."""
    import matplotlib

    style = Style(colour_by="displacement", colour_range=(2.0, 12.0), colour_map="viridis")
    (scale,) = Colouring(gripper, style, FRAMES, gripper.surfaces).scales
    assert (scale.low, scale.high, scale.top) == (2.0, 12.0, f"12 to {scale.highest:.3g}")
    expected = matplotlib.colormaps["viridis"]([0.0, 0.0, 0.5, 1.0, 1.0])[:, :3]
    np.testing.assert_allclose(scale.colours(np.array([0.0, 2.0, 7.0, 12.0, 99.0])), expected, atol=2e-3)


def test_colours_mean_what_the_bars_say(gripper):
    colouring = Colouring(gripper, Style(colour_by="displacement", section="z=0"), FRAMES, gripper.surfaces)
    first, second = colouring.scales
    assert (first.title, second.title) == ("displacement [mm]", "pressure [kPa]")
    assert (second.low, second.high) == (0.0, 50.0)
    soft, cavity = gripper.surfaces[:2]
    assert np.allclose(first.colours(colouring.values(0).ravel()), SOFT[0])
    tips = soft.vertices(0)[:, 0] < -114.0
    at_tips = at_corners(soft, colouring.values(2))[tips[soft.triangles].ravel()]
    assert (first.colours(at_tips)[:, 1] < 0.4).all(), "violet"
    assert (first.high, first.top) == (
        first.high,
        f"{first.high:g} to {first.highest:.3g}" if first.highest > first.high else f"{first.high:g}",
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
        force_arrows(start, [0], 10.0).paint(None, None, 0, None)  # would fail if it tried to paint


def test_a_colour_scale_is_linear_and_holds_its_ends():
    scale = ColourScale("x", -10.0, 10.0, ((0.0, 0.0, 0.0), (0.5, 1.0, 0.0), (1.0, 0.0, 0.0)))
    colours = scale.colours(np.array([-20.0, -10.0, -5.0, 0.0, 10.0, 99.0]))
    expected = [[0, 0, 0], [0, 0, 0], [0.25, 0.5, 0], [0.5, 1, 0], [1, 0, 0], [1, 0, 0]]
    assert np.allclose(colours, expected)
    values = (0.7, 1.0, 1.1, 2.2, 101.0, 130.0, 500.0, 501.0)
    assert [round_up(value) for value in values] == [0.7, 1, 1.2, 2.5, 120, 150, 500, 600]


def test_the_caption_has_time_pressure_and_height(gripper):
    """Heights count from the moment before the base moves, as in metrics.json: there is none before."""
    assert caption_parts(gripper, 0) == ["0.00 s", "pressure 0.0 kPa"]
    assert caption_parts(gripper, 1)[2] == "cube raised 0.0 mm"
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
        times=np.zeros(3), actuators=actuators, row=lambda name, frame: rows[name], lift_start=0,
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
        force_arrows(gripper, FRAMES, radius).paint_scale(picture, camera, (0.0, 0.0, 0.0), 9.0)
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
        force_arrows(gripper, FRAMES, 500.0).paint(picture, camera, 2, plane)
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


# What a scene gives of its appearance.


PAGE = (Path(__file__).resolve().parents[2] / "docs" / "pictures.md").read_text(encoding="utf-8")

BEHIND, FINGER, CUBE, FLOOR, WALL = (16, 32, 48), (32, 192, 64), (224, 64, 32), (200, 48, 160), (48, 200, 200)
DARKEST_SIDE = 0.4
"""Least part of its colour in which a side of a body appears, in whatever light."""


def written(colour: tuple[int, int, int]) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)


def coloured_scene(plain: Scene) -> Scene:
    """The scene with a colour for everything, and without axes."""
    document = plain.model_dump(exclude_none=True)
    document["soft_bodies"]["finger"]["colour"] = written(FINGER)
    document["rigid_bodies"]["cube"]["colour"] = written(CUBE)
    document["obstacles"] = {
        name: {"plane": {"point": [0, 0, 0], "normal": [1, 0, 0]}, "colour": written(colour)}
        for name, colour in (("floor", FLOOR), ("wall", WALL))
    }
    document["appearance"] = {"background": written(BEHIND), "frame": False}
    return Scene.model_validate(document)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Recording]:
    """One frame of the made-up run in colours, with a floor, and a wall behind it."""
    folder = tmp_path_factory.mktemp("colours")
    model = fake_run.fake_model(floor=True)
    model.scene = coloured_scene(model.scene)
    behind = {"point": np.array([0.0, 0.0, 60.0]), "normal": np.array([0.0, 0.0, -1.0])}
    model.obstacles += (SimpleNamespace(name="wall", vertices=None, triangles=None, **behind),)
    output = RecordingOutput(folder)
    output.begin(model, fake_run.fake_state(0))
    output.end("completed")
    with read_recording(folder / "recording.h5") as opened:
        yield opened


def drawn(recording: Recording, folder: Path, **style: Any) -> np.ndarray:
    """Shape (180, 320, 3); from the side of the wall's normal, opaque, without text."""
    plain = {"caption": False, "cavity_pressure": False, "opacity": 1.0, "size": (320, 180), "eye": (80, 60, -120)}
    (path,) = render_pictures(recording.path, {"start": 0.0}, folder, Style(**{**plain, **style}))
    return np.asarray(Image.open(path).convert("RGB"), dtype=int)


def count_lit(picture: np.ndarray, colour: tuple[int, int, int]) -> int:
    """Number of pixels that have a colour under some light."""
    light = picture @ np.array(colour) / np.dot(colour, colour)
    off = np.abs(picture - light[..., None] * colour).max(axis=2)
    return int(((off < 4) & (light > DARKEST_SIDE) & (light <= 1.01)).sum())


def test_everything_has_the_colours_of_the_scene(recording: Recording, tmp_path: Path) -> None:
    picture = drawn(recording, tmp_path)
    for colour in (FINGER, CUBE, FLOOR, WALL):
        assert count_lit(picture, colour) > 200, colour
    seen_from_above = drawn(recording, tmp_path, eye=(60, 60, -400), target=(60, 300, 0))
    assert (np.abs(seen_from_above - BEHIND).max(axis=2) < 2).any()
    other = drawn(recording, tmp_path, eye=(60, 60, -400), target=(60, 300, 0), background="#f0f0f0")
    assert not (np.abs(other - BEHIND).max(axis=2) < 2).any()


def test_axes_are_drawn_where_user_or_scene_want_them(recording: Recording, tmp_path: Path) -> None:
    none, wanted, unwanted = (drawn(recording, tmp_path, **style) for style in ({}, {"axes": True}, {"axes": False}))
    np.testing.assert_array_equal(none, unwanted)
    rows, columns = np.nonzero((none != wanted).any(axis=2))
    assert rows.min() > 120 and columns.max() < 60, "they stand in the lower left corner"


def changed(recording: Recording, folder: Path, appearance: dict[str, Any], **bodies: dict[str, Any]) -> Path:
    """A copy of the recording whose scene says something else about how it looks."""
    import h5py

    path = folder / "recording.h5"
    shutil.copy(recording.path, path)
    document = recording.scene.model_dump(exclude_none=True)
    document["appearance"] |= appearance
    for name, keys in bodies.items():
        (document["soft_bodies"] | document["rigid_bodies"])[name] |= keys
    with h5py.File(path, "r+") as file:
        del file["scene"]
        write_texts(file, "scene", [scene_to_toml(Scene.model_validate(document))])
    return path


def test_light_comes_from_where_the_scene_says(recording: Recording, tmp_path: Path) -> None:
    """Sides of the cube are bright where their normal points to the light; above is +x."""
    normals = np.vstack([np.eye(3), -np.eye(3)])
    for direction in normals:
        scene = recording.scene.model_copy(update={"appearance": Appearance(light=tuple(7.0 * direction))})
        lit = shade(np.ones(3), normals, key_light(scene), scene.up)[:, 0]
        assert normals[lit.argmax()] @ direction == 1.0
    usual = key_light(recording.scene)
    assert np.linalg.norm(usual) == pytest.approx(1.0) and usual @ recording.scene.up > 0.5


def test_shadows_fall_away_from_the_light(recording: Recording) -> None:
    casters = [(fake_run.CUBE + np.array([40.0, 0.0, 0.0]), fake_run.CUBE_FACES, 1.0)]
    plane = Plane("floor", np.zeros(3), np.array([1.0, 0.0, 0.0]))
    camera = fit_camera(casters[0][0], plane.normal, "top", 16 / 9)
    background = np.full((180, 320, 3), 200, dtype=np.uint8)

    def dark(light: Any, thrown: Any = casters) -> np.ndarray:
        """Middle of the shadow in the directions right and front of the scene."""
        floor = Floor(plane, casters[0][0], np.ones(3), np.ones(3), light)
        taken = 255.0 - floor.paint(background, camera, thrown).mean(axis=2)
        rows, columns = np.indices(taken.shape)
        total = taken.sum()
        return np.array([(taken * (columns - 159.5)).sum(), (taken * (rows - 89.5)).sum()]) / total if total else total

    right, front, _ = scene_axes(plane.normal)
    for across in (right, -right, front, -front):
        middle = dark(tuple(plane.normal + 0.5 * across)) - dark(tuple(plane.normal))
        assert middle @ [across @ right, across @ front] < -5.0
    assert dark((-1.0, 0.0, 0.0)) == dark(None, []) == 0.0, "light from below, and nothing that casts one"


def test_bodies_have_arrows_for_axes_where_the_scene_wants_them(recording: Recording, tmp_path: Path) -> None:
    marked = changed(recording, tmp_path, {}, cube={"axes": True})
    with read_recording(marked) as opened:
        with_axes, without = (drawn(opened, tmp_path, body_axes=wanted) for wanted in (True, False))
    np.testing.assert_array_equal(without, drawn(recording, tmp_path))
    rows, columns = np.nonzero((with_axes != without).any(axis=2))
    on_cube = np.abs(without - CUBE).max(axis=2) < 200
    assert len(rows) > 30 and on_cube[rows, columns].any()
    for colour in ON_DARK:
        assert (np.abs(with_axes - 255 * np.array(colour)).max(axis=2) < 4).any()


@pytest.mark.parametrize(
    ("behind", "expected"),
    [((), 0), (((0.86, 0.90, 0.94),), 0), (((0.8, 0.2, 0.1),), 1), (((0.8, 0.2, 0.1), (1, 0.9, 0.3)), 2)],
)
def test_arrows_of_forces_have_a_colour_that_is_seen(behind: Any, expected: int) -> None:
    assert arrow_colour([np.array(one) for one in behind]) == FORCE_COLOURS[expected]


def test_what_the_user_chose_wins_over_the_scene(recording: Recording) -> None:
    scene, plain = recording.scene, fake_run.fake_model().scene
    own = Style().for_scene(scene)
    assert own.background_colour == pytest.approx(np.array(BEHIND) / 255) and own.axes is False
    chosen = Style(background="#ffffff", axes=True).for_scene(scene)
    assert chosen.background_colour == (1.0, 1.0, 1.0) and chosen.axes is True
    usual = Style().for_scene(plain)
    assert usual.eye is None
    filmed = plain.model_copy(update={"appearance": Appearance(eye=(300.0, 0.0, 50.0), target=(0.0, 0.0, 10.0))})
    assert (Style().for_scene(filmed).eye, Style().for_scene(filmed).target) == ((300.0, 0.0, 50.0), (0.0, 0.0, 10.0))
    assert Style(view="iso").for_scene(filmed).eye is None
    asked = Style(eye=(1.0, 2.0, 3.0)).for_scene(filmed)
    assert (asked.eye, asked.target) == ((1.0, 2.0, 3.0), None)
    assert usual.background_colour == BACKGROUND and usual.axes is True


@pytest.mark.parametrize("colour", ["#ffffff", "#808080"])
def test_transparent_picture_over_a_colour_is_that_with_the_colour(gripper, tmp_path, colour) -> None:
    """The chosen colour is that of the floor, too, but for the shadow, which a transparent picture keeps."""
    style = {"size": (320, 180), "caption": False, "axes": False, "bars": False, "arrows": False}
    (path,) = render_pictures(gripper.path, {"clear": 0.02}, tmp_path, Style(transparent=True, **style))
    (filled,) = render_pictures(gripper.path, {"filled": 0.02}, tmp_path, Style(background=colour, **style))
    with Image.open(path) as clear, Image.open(filled) as expected:
        alpha = np.asarray(clear)[..., 3]
        assert (alpha == 0).any() and ((alpha > 20) & (alpha < 80)).any() and (alpha == 255).any()
        sheet = Image.new("RGBA", clear.size, colour)
        sheet.alpha_composite(clear)
        off = np.abs(np.asarray(sheet.convert("RGB"), int) - np.asarray(expected.convert("RGB"), int)).max(axis=2)
    assert np.mean(off > 4) < 0.02, "edges are smoothed where they are seen"


@pytest.mark.parametrize("section", [None, "z=0"])
def test_pressures_are_those_of_the_bar_in_bodies_of_any_colour(gripper, tmp_path, section) -> None:
    """Red silicone with light on it moves none of them off the bar; a cut cavity shows its far walls, with lines."""
    import h5py

    scene = gripper.scene.model_dump(exclude_none=True)
    for body in scene["soft_bodies"].values():
        body["colour"] = "#c8321e"
    with h5py.File(shutil.copy(gripper.path, tmp_path / "red.h5"), "r+") as file:
        del file["scene"]
        write_texts(file, "scene", [scene_to_toml(Scene.model_validate(scene))])
    style = Style(size=(320, 180), bars=False, caption=False, section=section, view="front", axes=False)
    (path,) = render_pictures(tmp_path / "red.h5", {"red": 0.02}, tmp_path, style)
    picture = np.asarray(Image.open(path).convert("RGB"), int).reshape(-1, 3)
    green = picture[(picture[:, 1] > picture[:, 0] + 20) & (picture[:, 1] >= picture[:, 2])]
    share = green @ as_bytes(AIR[-1]) / np.dot(as_bytes(AIR[-1]), as_bytes(AIR[-1]))
    assert (green == as_bytes(AIR[-1])).all(axis=1).sum() > 400
    assert ((share < 0.95) & (green[:, 0] == 0)).sum() > 50, "lines"


def test_chosen_background_is_exact_and_transparency_whole(gripper, tmp_path) -> None:
    plain = {"size": (320, 180), "caption": False, "axes": False, "bars": False, "arrows": False}
    (path,) = render_pictures(gripper.path, {"white": 0.02}, tmp_path, Style(background="#ffffff", **plain))
    white = np.asarray(Image.open(path).convert("RGB"))
    assert (white[:12] == 255).all() and (white[:, :20] == 255).all() and (white[-1, -20:] == 255).all()
    (path,) = render_pictures(gripper.path, {"clear": 0.02}, tmp_path, Style(transparent=True, **plain))
    assert (np.asarray(Image.open(path))[:12, :, 3] == 0).all()


def test_a_section_has_no_shadow_of_what_is_cut_off(gripper, tmp_path) -> None:
    """What is grey on white lies beside the bodies, and none of it on the side that is cut off."""
    plain = {"size": (320, 180), "caption": False, "axes": False, "bars": False, "arrows": False, "view": "top"}
    dark = []
    for name, section in (("whole", None), ("left", "y<60")):
        style = Style(background="#ffffff", section=section, **plain)
        (path,) = render_pictures(gripper.path, {name: 0.02}, tmp_path, style)
        right = np.asarray(Image.open(path).convert("RGB"), int)[:, 160:]
        dark.append(int(((right.max(axis=2) < 245) & (np.ptp(right, axis=2) < 2)).sum()))
    assert dark[0] > 1000 > 20 > dark[1]


def test_bodies_and_materials_have_colours_and_names(gripper) -> None:
    by_body = Colouring(gripper, Style(colour_by="body"), FRAMES, gripper.surfaces)
    (scale,) = by_body.scales
    assert scale.names == ("finger1", "finger2", "finger3", "cube")
    assert len(set(scale.steps)) == 4
    for number, name in enumerate(scale.names):
        surface = next(surface for surface in gripper.surfaces if surface.name == name)
        shown = (
            scale.colours(by_body.at_corners(surface, by_body.values(1)))
            if surface.kind == "soft"
            else by_body.colours(1)[name][None]
        )
        np.testing.assert_allclose(shown, np.tile(scale.steps[number], (len(shown), 1)))
        assert by_body.unlit[name], "its colour is that of the legend"
    (scale,) = Colouring(gripper, Style(colour_by="material", colour_map="tab10"), FRAMES, gripper.surfaces).scales
    assert scale.names == ("hooke, E 500 kPa, nu 0.3", "hooke, E 1500 kPa, nu 0.3"), "three fingers alike"
    assert scale.colours(np.array([0.0])).tolist() == [list(scale.steps[0])]


def test_twenty_bodies_have_twenty_colours(gripper, monkeypatch) -> None:
    names = [f"ball {number}" for number in range(20)]
    monkeypatch.setitem(NAMED, "body", lambda recording: (names, lambda instant: np.zeros((1, 1))))
    assert len(set(Colouring(gripper, Style(colour_by="body"), FRAMES, gripper.surfaces).scales[0].steps)) == 20


@pytest.mark.parametrize("choice", [{"colour_by": "contact"}, {"colour_by": "material"}, {"displacement_arrows": 2.0}])
def test_what_soft_bodies_alone_have_is_refused_without_them(choice, falling_cube) -> None:
    with pytest.raises(StyleError, match="are of soft bodies, and there are none"):
        Style(**choice).check(load_scene(falling_cube))


def test_triangles_show_the_material_behind_them(gripper) -> None:
    """The materials of one finger alternate, so that all nodes have parts in both and say nothing."""
    body, surface = gripper.soft_bodies[0], gripper.surfaces[0]
    odd = np.arange(len(body.elements)) % 2
    recording = SimpleNamespace(scene=gripper.scene, soft_bodies=(replace(body, material=odd),))
    colouring = object.__new__(Colouring)
    colouring._recording, colouring._materials = recording, {}
    values = np.tile([3.0, 7.0], (len(gripper.row("position", 0)), 1))
    shown = colouring.at_corners(surface, values).reshape(-1, 3)
    nodes = np.sort(surface.mapping.nodes[:, 0][surface.triangles], axis=1)
    for triangle, found in zip(nodes[::37], shown[::37], strict=True):
        (behind,) = np.flatnonzero(np.isin(body.tetrahedra, triangle - body.nodes.start).sum(axis=1) == 3)
        assert found.tolist() == [[3.0, 7.0][behind % 2]] * 3


def test_arrows_of_displacements_lead_from_the_kept_shape(gripper) -> None:
    """Twice as long from the same ends: the tails are where points would be, and further away by the displacement."""
    ways = displacements(gripper)(2)
    assert np.linalg.norm(ways, axis=1) == pytest.approx(displacement(gripper)(2)[:, 0])
    once, twice = (displacement_arrows(gripper, [2], 80.0, (0, 0, 0), times).tails for times in (1.0, 2.0))
    kept = gripper.row("position", 2) - ways
    off = np.linalg.norm(once[:, None] - kept, axis=2).min(axis=1)
    assert 60 < len(once) < 1500 and off.max() < 1e-6
    moved = gripper.row("position", 2)
    nearest = np.linalg.norm((2 * once - twice)[:, None] - moved, axis=2).min(axis=1)
    assert nearest.max() < 1e-6


def test_colours_that_mean_something_win_over_those_of_bodies(recording: Recording) -> None:
    finger, cavity, cube = recording.surfaces
    plain = Colouring(recording, Style(), [0], recording.surfaces).colours(0)
    assert plain[finger.name] == pytest.approx(np.array(FINGER) / 255)
    assert plain[cube.name] == pytest.approx(np.array(CUBE) / 255)
    assert tuple(plain[cavity.name]) == PLAIN["cavity"]
    moved = Colouring(recording, Style(colour_by="displacement"), [0], recording.surfaces)
    assert len(moved.values(0)) == len(recording.row("position", 0)), "a value for each node"
    assert finger.name in moved.unlit


def page_of(scene: Scene) -> tuple[MagicMock, Any, PageInstant]:
    """A page with a finger, its cavity, a cube and a floor, the server that it is drawn on, and a frame of it."""
    kinds = (("finger", "soft"), ("finger.cavity", "cavity"), ("cube", "rigid"))
    surfaces = [BodySurface(*one, fake_run.CUBE_FACES, fake_run.CUBE) for one in kinds]  # type: ignore[arg-type]
    planes = [Plane("floor", np.array([-1.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))]
    points = np.array([[1.0, 2.0, 3.0]])
    turned = np.full((1, 4), 0.5)  # x points to where y was, y to z, z to x
    poses = ShownPoses(np.zeros((0, 3)), np.array([[10.0, 20.0, 30.0]]), turned)
    frame = PageInstant(0.0, poses, {}, points, 60.0 * points, np.array([30.0, 0.0, 0.0]))
    server = MagicMock()
    server.scene.add_mesh_simple.side_effect = lambda name, *_, **look: SimpleNamespace(name=name, **look)
    actuators = ActuatorNames({"cavity": ("finger.cavity",), "cable": ()})
    content = PageScene(scene, surfaces, planes, actuators, {"cube": RigidAxes(0)})
    return server, SceneView(server, content, frame), frame


def test_a_page_explains_its_colours_and_arrows() -> None:
    _, view, frame = page_of(fake_run.fake_model().scene)
    panel = SimpleNamespace(content="")
    view.put_scales(panel)
    view.show(frame)
    (cavity,) = (mesh for mesh in view._meshes if mesh.name == "/finger.cavity")
    assert cavity.color == tuple(round(255 * part) for part in AIR[-1])
    assert "pressure [kPa]" in panel.content and ">0<" in panel.content and "30</div>" in panel.content
    assert f"longest arrow {60 * 14**0.5:.3g} mN" in panel.content
    view.reach_to({"cavity": np.array([90.0])}, 0.0)
    view.show(frame)
    expected = np.array([np.interp(1 / 3, np.linspace(0, 1, len(AIR)), part) for part in np.array(AIR).T])
    assert cavity.color == tuple(round(255 * float(part)) for part in expected)


@pytest.mark.parametrize("framed", [True, False])
def test_a_page_draws_axes_of_scene_and_bodies(framed: bool) -> None:
    scene = fake_run.fake_model().scene.model_copy(update={"appearance": Appearance(frame=framed, shadows=False)})
    server, view, frame = page_of(scene)
    names = [call.args[0] for call in server.scene.add_frame.call_args_list]
    assert names == [*(["/axes"] if framed else []), "/axes of cube"]
    assert [call.args[1] for call in server.scene.add_label.call_args_list] == (list("xyz") if framed else [])
    view.show(frame)
    _, handle = view._axes[0]
    np.testing.assert_allclose(handle.position, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(matrices_from_quaternions(handle.wxyz[None])[0].T, np.eye(3)[[1, 2, 0]], atol=1e-12)
    assert server.scene.add_light_directional.call_args.kwargs["cast_shadow"] is False


@pytest.mark.parametrize("coloured", [True, False])
def test_a_page_has_the_colours_of_the_scene(coloured: bool) -> None:
    plain = fake_run.fake_model().scene
    scene = coloured_scene(plain) if coloured else plain
    server, _, _ = page_of(scene)
    calls = server.scene.add_mesh_simple.call_args_list
    added = {call.args[0]: call.kwargs["color"] for call in calls if "color" in call.kwargs}
    backgrounds = [call.args[0].tolist() for call in server.scene.set_background_image.call_args_list]
    if coloured:
        assert added == {"/finger": FINGER, "/finger.cavity": as_bytes(PLAIN["cavity"]), "/cube": CUBE, "/floor": FLOOR}
        assert backgrounds == [[[list(BEHIND)]]]
    else:
        kinds = {"/finger": "soft", "/finger.cavity": "cavity", "/cube": "rigid", "/floor": "floor"}
        assert added == {name: as_bytes((PLAIN | {"floor": PLAIN_FLOOR})[kind]) for name, kind in kinds.items()}
        assert not backgrounds


def test_the_example_of_the_documents_is_a_scene() -> None:
    (text,) = re.findall(r"```toml\n(\[appearance\].*?)```", PAGE, re.DOTALL)
    scene = scene_from_toml(text, "pictures.md")
    assert set(body_colours(scene)) == {"cube", "floor"}
    assert Style().for_scene(scene).axes is False
    assert list(axes_of_bodies(scene, ())) == ["cube"] and scene.appearance.light == (1.0, -1.0, 2.0)
