"""Drawing without Open3D's part in it: what may be chosen, cameras, light, shadows, floor, layers, smooth edges."""

import json
from dataclasses import asdict

import fake_run
import numpy as np
import pytest
import trimesh
from PIL import Image

from taichisoft.base import run_python
from taichisoft.mechanics import Plane
from taichisoft.mesh import SectionPlane
from taichisoft_outputs import Style
from taichisoft_outputs.drawing.camera import (
    MARGIN,
    VERTICAL_ANGLE,
    VIEW_DIRECTIONS,
    PictureCamera,
    camera_path,
    depth_of_scale,
    fit_camera,
    followed_part,
    outermost_points,
    project,
    scene_axes,
    seen_from_front,
    seen_radius,
)
from taichisoft_outputs.drawing.colouring import ColourScale, sample_instants
from taichisoft_outputs.drawing.drawer import antialias
from taichisoft_outputs.drawing.overlay import (
    arrow_outline,
    font_of,
    paint_colour_bars,
    paint_polygon,
    paint_scale_bar,
    text_colour,
)
from taichisoft_outputs.drawing.stage import EMPTY, PIXELS, SUN_RADIUS, Floor, reaches_under, shadow, square_of_plane
from taichisoft_outputs.drawing.style import StyleError
from taichisoft_outputs.drawing.surface_painter import KEY_LIGHT, SmoothNormals, depth_layers, lay_over, shade
from taichisoft_outputs.recording.reader import RecordedSurface

# What a style refuses.


@pytest.mark.parametrize(
    ("choice", "complaint"),
    [
        ({"size": (1280, 8)}, "size 1280x8: width and height must be whole numbers from 16 to 8192 pixels"),
        ({"size": (640.5, 480)}, "size 640.5x480: width and height must be whole numbers"),
        ({"size": (640,)}, r"size \(640,\) must be 2 numbers"),
        ({"view": "back"}, "no view is called 'back'; there are: iso, front, top, orbit, follow:BODY"),
        ({"view": "follow:"}, "no view is called 'follow:'"),
        ({"opacity": 0.0}, "opacity 0 must be above 0 and at most 1"),
        ({"opacity": float("nan")}, "opacity nan must be above 0"),
        ({"colour_by": "strain", "colour_range": (1.0, 1.0)}, "colour range 1:1: the first must be below"),
        ({"colour_by": "strain", "colour_range": (0.0, float("nan"))}, "must be 2 numbers"),
        ({"colour_range": (0.0, 1.0)}, "needs colours that mean something: colour by displacement or"),
        ({"colour_by": "strain", "colour_map": "virdis"}, "no colour map of Matplotlib is called 'virdis'"),
        ({"colour_by": "heat"}, "cannot be coloured by 'heat'; there are: none, displacement, stress"),
        ({"background": "#12345"}, "background '#12345' must be written #rrggbb"),
        ({"background": (0.1, 0.2, 1.5)}, "red, green and blue must each be from 0 to 1"),
        ({"eye": (1.0, 2.0)}, r"eye \(1.0, 2.0\) must be 3 numbers"),
        ({"target": (0.0, 0.0, 0.0)}, "target needs an eye"),
        ({"eye": (1, 2, 3), "target": (1, 2, 3)}, "eye and target are one point"),
        ({"eye": (1, 2, float("inf"))}, "must be 3 numbers"),
        ({"key_frames": [(0, 1, 2, 3)]}, r"key frame \(0, 1, 2, 3\) must be 7 numbers"),
        ({"key_frames": [(0, 1, 2, 3, 0, 0, 0)]}, "key frames at 0 s: there must be two or more"),
        ({"key_frames": [(1, 1, 2, 3, 0, 0, 0), (1, 2, 2, 3, 0, 0, 0)]}, "each later than the one before"),
        ({"key_frames": [(0, 1, 2, 3, 0, 0, 0), (1, 2, 2, 3, 2, 2, 3)]}, "at 1 s: eye and target are one point"),
        ({"key_frames": [(0, 1, 2, 3, 0, 0, 0), (1, 2, 2, 3, 0, 0, 0)], "view": "top"}, "neither a view nor an eye"),
        ({"displacement_arrows": float("nan")}, "displacement arrows nan times as long must be above 0"),
        ({"colour_by": "body", "colour_range": (0.0, 1.0)}, "colours by body have names, and no colour range"),
    ],
)
def test_an_impossible_choice_is_named(choice, complaint):
    with pytest.raises(StyleError, match=complaint):
        Style(**choice)


def test_a_style_comes_back_from_what_json_makes_of_it():
    style = Style(size=(320, 180), eye=(1, 2, 3), background="#ff0080", surface="finger.stl")
    plain = {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(style).items()}
    assert Style(**plain) == style
    assert style.background_colour == pytest.approx((1.0, 0.0, 128 / 255))


def test_an_eye_takes_the_place_of_a_followed_body():
    assert Style(view="follow:cube").followed == "cube"
    assert Style(view="follow:cube", eye=(1, 2, 3)).followed is None


# The camera sees everything, and stands no further away than needed.


def pinhole(camera, points, aspect):
    """Picture coordinates from -1 to 1, shape (count, 2), and depths (count,), of a pinhole camera."""
    forward = camera.target - camera.eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, camera.up)
    right /= np.linalg.norm(right)
    offset = points - camera.eye
    depth = offset @ forward
    scale = depth * np.tan(np.radians(VERTICAL_ANGLE / 2))
    picture = [offset @ right / (scale * aspect), offset @ np.cross(right, forward) / scale]
    return np.stack(picture, axis=1), depth


@pytest.mark.parametrize("view", VIEW_DIRECTIONS)
@pytest.mark.parametrize("extent", [(1, 1, 1), (200, 10, 10), (10, 10, 300), (0.1, 40, 3)])
@pytest.mark.parametrize("up", [(0, 0, 1), (1, 0, 0), (0, -1, 0), (0.6, 0, 0.8)])
def test_nothing_is_cut_off_and_nothing_could_be_larger(view, extent, up):
    points = np.random.default_rng(1).random((50, 3)) * extent + [300.0, -20.0, 5.0]
    aspect = 16 / 9
    seen, depth = pinhole(fit_camera(points, np.array(up, float), view, aspect), points, aspect)
    # The tangent of the half angle is shortened by the margins, so the extreme point lies exactly on one,
    # unless the camera would come closer than half the radius of what it looks at.
    largest = np.abs(seen).max()
    radius = np.linalg.norm(points - points.mean(axis=0), axis=1).max()
    assert depth.min() >= radius / 2 - 1e-9
    assert largest <= 1 - 2 * MARGIN + 1e-9
    assert largest == pytest.approx(1 - 2 * MARGIN) or depth.min() == pytest.approx(radius / 2)


def test_axes_are_right_handed_and_orthonormal():
    for up in np.vstack([np.eye(3), -np.eye(3), [[0.6, 0.0, 0.8]]]):
        axes = scene_axes(up)
        assert np.allclose(axes @ axes.T, np.eye(3), atol=1e-12)
        right, front, above = axes
        assert np.array_equal(above, up)
        assert np.allclose(np.cross(right, above), front), "front points to the viewer"


# In every instant all that moves is in the picture, wherever the camera goes.


SIZE = (320, 180)
ABOVE = np.array([1.0, 0.0, 0.0])
FRAMES = range(24)
CUBE = np.array([[x, y, z] for x in (-5.0, 5.0) for y in (-5.0, 5.0) for z in (-5.0, 5.0)])
FACES = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5]])


def moving(name, kind, at):
    return RecordedSurface(name, kind, FACES, lambda frame: CUBE + np.asarray(at(frame), dtype=float))


SURFACES = (
    moving("cube", "rigid", lambda frame: [0.0, 0.0, 0.0]),
    # Far away in one frame alone: a look at some of the frames would miss it.
    moving("ball", "soft", lambda frame: [60.0 if frame == 13 else 0.0, frame, 20.0]),
    moving("mountain", "obstacle", lambda frame: [0.0, 5000.0, 0.0]),
)


def path_of(style):
    followed = followed_part(None, SURFACES, style.followed) if style.followed else None
    return camera_path(style, FRAMES, outermost_points(SURFACES, FRAMES), ABOVE, SIZE[0] / SIZE[1], followed)


@pytest.mark.parametrize("view", ["iso", "front", "top", "orbit"])
def test_nothing_that_moves_is_cut_off_in_any_frame(view):
    path = path_of(Style(size=SIZE, view=view))
    edge = MARGIN * np.array(SIZE)
    reached = []
    for frame in FRAMES:
        points = np.concatenate([surface.vertices(frame) for surface in SURFACES if surface.kind != "obstacle"])
        pixels, depth = project(path(frame), points, SIZE)
        assert depth.min() > 1.0
        assert (pixels >= edge - 0.5).all() and (pixels <= SIZE - edge + 0.5).all()
        reached.append(np.minimum(pixels - edge, SIZE - edge - pixels).min())
    # An orbit is seen at some turns only, and chosen for all of them.
    assert min(reached) < (40.0 if view == "orbit" else 1.0), "it could stand nearer"


def test_an_orbit_goes_once_around_the_vertical():
    path = path_of(Style(view="orbit"))
    cameras = [path(frame) for frame in FRAMES]
    offsets = np.array([camera.eye - camera.target for camera in cameras])
    assert np.ptp(offsets[:, 0]) < 1e-9, "its height stays"
    turns = np.unwrap(np.arctan2(offsets[:, 2], offsets[:, 1]))
    assert np.allclose(np.diff(turns), turns[1] - turns[0])
    assert abs(turns[1] - turns[0]) == pytest.approx(2 * np.pi / len(FRAMES))


def test_a_camera_moves_through_its_key_frames():
    """It is there at each of their times, overshoots nowhere, and stands before the first and after the last."""
    keys = [(3.0, 300, 0, 40, 0, 0, 0), (7.0, 100, 80, 40, 10, 0, 0), (9.0, 100, 80, 40, 10, 0, 20)]
    path = camera_path(
        Style(key_frames=keys), FRAMES, CUBE, ABOVE, 1.5, times=np.arange(len(FRAMES)) * 0.5
    )  # of an instant 0.5 s
    for time, *points in [(0.0, *keys[0][1:]), *keys, (11.5, *keys[-1][1:])]:
        camera = path(round(2 * time))
        np.testing.assert_allclose([*camera.eye, *camera.target], points, atol=1e-9)
    between = np.array([path(instant).eye for instant in range(6, 15)])
    assert (np.diff(between[:, 0]) < 0.0).all() and (np.diff(between[:, 1]) > 0.0).all()
    assert np.ptp(between[:, 2]) < 1e-9


def test_a_camera_that_meets_its_target_is_refused():
    """It is refused before anything is drawn, at the instant in which there is no direction to look in."""
    keys = [(0.0, 0, 0, 300, 0, 0, 0), (2.0, 0, 0, -300, 0, 0, 0)]
    with pytest.raises(StyleError, match="key frames: at 1 s the camera meets its target"):
        camera_path(Style(key_frames=keys), FRAMES, CUBE, ABOVE, 1.5, times=np.arange(len(FRAMES)) * 0.5)


def test_a_legend_of_many_names_fits_in_the_picture():
    """Thirty names, one of them as long as names may be, above a bar; and letters that English has not are drawn."""
    legend = ColourScale("body", 0.0, 29.0, [(0.0, 0.0, 1.0)] * 30, names=("n" * 200, *map(str, range(29))))
    bar = ColourScale("pressure [kPa]", 0.0, 9.0, [(0.0, 1.0, 0.0), (1.0, 0.0, 0.0)])
    picture = Image.new("RGB", (1280, 720), "white")
    paint_colour_bars(picture, [legend, bar], (0.0, 0.0, 0.0), 20.0)
    drawn = np.asarray(picture).min(axis=2) < 128
    assert not drawn[:, : 1280 // 2].any() and not drawn[-2:].any()
    blue = (np.asarray(picture) == (0, 0, 255)).all(axis=2).any(axis=1)
    assert (np.diff(blue.astype(int)) == 1).sum() == 30, "boxes with space between them"
    missing, umlaut = (font_of(text, 20.0).getmask(text).getbbox() for text in ("\uffff", "ü"))
    assert missing != umlaut, "no box in the place of the letter"


def test_close_ups_see_less_than_the_scene():
    """Half the height of the picture at what is looked at, or the radius around a body; never more than the scene."""
    points = 1000.0 * np.vstack([np.eye(3), -np.eye(3)])
    half = np.tan(np.radians(VERTICAL_ANGLE / 2))
    assert seen_radius(Style(), points, None) == pytest.approx(1000.0)
    assert seen_radius(Style(eye=(200, 0, 0), target=(0, 0, 0)), points, None) == pytest.approx(200.0 * half)
    assert seen_radius(Style(eye=(9e4, 0, 0), target=(0, 0, 0)), points, None) == pytest.approx(1000.0)
    assert seen_radius(Style(view="follow:cube"), points, (lambda instant: points[0], 12.0)) == 12.0
    keys = [(0, 300, 0, 0, 0, 0, 0), (1, 100, 0, 0, 0, 0, 0)]
    assert seen_radius(Style(key_frames=keys), points, None) == pytest.approx(100.0 * half)


@pytest.mark.parametrize("size", [(640, 480), (3840, 2160)])
@pytest.mark.parametrize("section", [None, "x=50"])
def test_a_scale_bar_is_as_long_as_its_length(size, section):
    """The pixels between two points so far apart, at the target or on the section; its line is as thick as letters."""
    camera = PictureCamera(np.array([400.0, 30.0, 20.0]), np.array([0.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    plane = None if section is None else SectionPlane.parse(section)
    depth = depth_of_scale(camera, plane)
    middle = camera.eye - depth * camera.axes[2]
    next_to_target = np.array([0.0 if section is None else 50.0, 0.0, 0.0])
    assert (middle - next_to_target) @ camera.axes[2] == pytest.approx(0.0, abs=1e-9)
    picture = Image.new("RGB", size, "white")
    paint_scale_bar(picture, depth, (0.0, 0.0, 0.0), size[1] / 36)
    dark = np.asarray(picture)[..., 0] < 128
    bar = dark[dark.sum(axis=1).argmax()].sum()
    ends, _ = project(camera, np.array([middle, middle + 20.0 * camera.axes[0], middle + 50.0 * camera.axes[0]]), size)
    lengths = np.linalg.norm(ends[1:] - ends[0], axis=1)
    assert min(abs(bar - lengths)) <= 1.5
    assert 0.08 * size[0] < bar <= 0.2 * size[0] + 1
    assert (dark.sum(axis=1) >= bar).sum() == pytest.approx(0.3 * size[1] / 36, abs=1.5), "thick"


@pytest.mark.parametrize(("section", "height"), [("z=5", 5.0), ("z=-5", -5.0), ("y=0", 0.0), ("x=900", 0.0)])
def test_scales_of_sections_seen_edge_on_are_near_the_target(section, height):
    """Where the view meets z = -5 nothing is, 80 mm behind the target; x = 900 lies behind the camera."""
    camera = PictureCamera(np.array([400.0, 0.0, 30.0]), np.zeros(3), np.array([0.0, 0.0, 1.0]))
    distance = np.hypot(400.0, 30.0)
    assert depth_of_scale(camera, SectionPlane.parse(section)) == pytest.approx(distance - height * 30.0 / distance)


def test_a_followed_body_stays_at_its_place():
    path = path_of(Style(view="follow:ball"))
    seen = [project(path(frame), SURFACES[1].vertices(frame), SIZE)[0] for frame in FRAMES]
    assert np.allclose(seen, seen[0], atol=1e-6)
    height = np.ptp(seen[0][:, 1]) / SIZE[1]
    assert 0.4 < height < 1 - 2 * MARGIN, "near, and whole"


def test_an_explicit_camera_looks_at_its_target():
    eye, target = (100.0, 30.0, 50.0), (1.0, 2.0, 3.0)
    camera = path_of(Style(size=SIZE, eye=eye, target=target))(0)
    pixels, depth = project(camera, np.array([target, [2.0, 2.0, 3.0]]), SIZE)
    assert pixels[0] == pytest.approx([160.0, 90.0])
    assert depth[0] == pytest.approx(np.linalg.norm(np.subtract(eye, target)))
    assert pixels[1, 1] < 90.0, "x is up"
    from_above = path_of(Style(size=SIZE, eye=(100.0, 0.0, 0.0), target=(0.0, 0.0, 0.0)))(0)
    assert np.isfinite(from_above.axes).all()


def test_triangles_facing_the_camera_are_seen():
    camera = path_of(Style(eye=(100.0, 0.0, 0.0), target=(0.0, 0.0, 0.0)))(0)
    assert seen_from_front(camera, CUBE[FACES]).tolist() == [False, False, True, True]


def test_flat_and_tiny_things_have_outermost_points_too():
    flat = RecordedSurface(
        "flat", "soft", FACES, lambda frame: np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    )
    assert len(outermost_points([flat], [0])) == 4
    grid = np.stack(np.meshgrid(*[np.arange(5.0)] * 2), axis=-1).reshape(-1, 2)
    sheet = RecordedSurface("sheet", "soft", FACES, lambda frame: np.column_stack([grid, np.zeros(25)]))
    kept = outermost_points([sheet], [0])
    assert {(0.0, 0.0), (4.0, 0.0), (0.0, 4.0), (4.0, 4.0)} <= {(x, y) for x, y, _ in kept}


def test_a_frame_without_finite_positions_is_named():
    broken = moving("ball", "soft", lambda frame: [np.nan if frame == 3 else 0.0, 0.0, 0.0])
    with pytest.raises(StyleError, match="instant 3 cannot be drawn: positions of 'ball' are not finite"):
        outermost_points([SURFACES[0], broken], range(5))


def test_frames_are_spread_with_first_and_last():
    assert sample_instants(range(10, 20), 3) == [10, 14, 19]
    assert sample_instants([4], 3) == [4]


# Edges stay sharp and curved faces are smooth.


KEY = np.array(KEY_LIGHT) / np.linalg.norm(KEY_LIGHT)


def test_a_cube_keeps_its_faces_flat():
    corners, normals = SmoothNormals(fake_run.CUBE_FACES)(fake_run.CUBE)
    triangles = corners.reshape(-1, 3, 3)
    centres = triangles.mean(axis=1)
    outward = (
        np.eye(3)[np.abs(centres).argmax(axis=1)] * np.sign(centres[np.arange(12), np.abs(centres).argmax(1)])[:, None]
    )
    assert np.allclose(normals.reshape(-1, 3, 3), outward[:, None], atol=1e-12)


def test_a_sphere_has_radial_normals():
    sphere = trimesh.creation.icosphere(subdivisions=3)
    corners, normals = SmoothNormals(np.array(sphere.faces))(np.array(sphere.vertices))
    radial = corners / np.linalg.norm(corners, axis=1, keepdims=True)
    # The facets are turned against the radius by up to 5 degrees; their mean at a vertex by 0.7.
    assert np.degrees(np.arccos(np.einsum("ij,ij->i", normals, radial).min())) < 1.0


def test_no_light_makes_a_body_look_like_nothing():
    """What has the colour of an empty stage, magenta, is dimmer from every side: it would be a hole in the picture."""
    normals = np.array(trimesh.creation.icosphere(subdivisions=4).vertices)
    brightest = 255 * shade(np.array(EMPTY) / 255, normals, KEY, np.eye(3)[2]).max()
    assert 240 < brightest < 254


# Shadows, floor, layers, smooth edges, arrows.


RIGHT, FRONT, UP = np.eye(3)
PICTURE = (320, 180)


def test_a_shadow_moves_and_softens_with_height():
    sun = np.array([1.0, 0.0, 2.0])
    half = 40.0
    widths = []
    for height in (0.0, 30.0):
        cube = fake_run.CUBE + np.array([0.0, 0.0, 5.0 + height])
        dark = shadow([(cube, fake_run.CUBE_FACES, 1.0)], np.zeros(3), RIGHT, FRONT, sun, half)
        assert dark.shape == (PIXELS, PIXELS) and dark.max() == pytest.approx(1.0, abs=0.05)
        rows, columns = np.indices(dark.shape)
        place = [(index * dark).sum() / dark.sum() / PIXELS * 2 * half - half for index in (columns, rows)]
        # The middle of the cube throws its shadow half its height times the slope of the light away from the sun.
        assert place == pytest.approx([-(5.0 + height) / 2, 0.0], abs=1.0)
        widths.append(np.count_nonzero((dark > 0.1) & (dark < 0.9)) / PIXELS**2)
    assert widths[1] > 2 * widths[0]
    assert 2 * SUN_RADIUS * 30.0 < 10.0, "what is that soft still has a core"


def test_silicone_throws_a_weaker_shadow():
    cube = fake_run.CUBE + np.array([0.0, 0.0, 10.0])
    sun = np.array([0.0, 0.0, 1.0])
    half_dark = shadow([(cube, fake_run.CUBE_FACES, 0.5)], np.zeros(3), RIGHT, FRONT, sun, 40.0)
    assert half_dark.max() == pytest.approx(0.5, abs=0.03)
    below = shadow([(cube - [0, 0, 30.0], fake_run.CUBE_FACES, 1.0)], np.zeros(3), RIGHT, FRONT, sun, 40.0)
    assert below.max() == 0.0


def test_the_floor_is_dark_under_a_body_and_fades():
    background = np.array([0.8, 0.8, 0.8])
    points = fake_run.CUBE + np.array([0.0, 0.0, 5.0])
    floor = Floor(Plane("floor", np.zeros(3), UP), points, background)
    camera = fit_camera(3 * points, UP, "front", PICTURE[0] / PICTURE[1])
    empty = np.full((180, 320, 3), 204, dtype=np.uint8)
    picture = floor.paint(empty, camera, [(points, fake_run.CUBE_FACES, 1.0)]).astype(int)
    (under, beside), _ = project(camera, np.array([[-1.0, 0.5, 0.0], [14.0, -3.0, 0.0]]), PICTURE)
    dark, light = (picture[int(y), int(x), 0] for x, y in (under, beside))
    assert dark < 0.8 * light
    assert light < 195, "the floor differs from what is behind it"
    assert (picture[0] == 204).all(), "above the horizon there is none"
    assert np.abs(np.diff(picture[:, 5, 0])).max() <= 3, "and no line where it begins"
    from_below = fit_camera(points, -UP, "top", PICTURE[0] / PICTURE[1])
    assert np.array_equal(floor.paint(empty, from_below, []), empty)


def test_slopes_and_walls_end_at_the_floor():
    floor = Plane("floor", np.zeros(3), UP)
    slope = Plane("slope", np.zeros(3), np.array([0.6, 0.0, 0.8]))
    vertices, triangles = square_of_plane(slope, fake_run.CUBE, [floor])
    assert vertices[:, 2].min() == pytest.approx(0.0, abs=1e-9)
    assert vertices[:, 2].max() > 5.0
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a) @ slope.normal > 0).all(), "seen from where things are"
    sunk, _ = square_of_plane(Plane("w", np.array([0, 0, -9.0]), -UP), fake_run.CUBE, [floor])
    assert len(sunk) == 0
    assert reaches_under(floor, fake_run.CUBE) and not reaches_under(floor, fake_run.CUBE + np.array([0, 0, 4.9]))


def test_bodies_share_a_layer_where_none_stands_before_another():
    camera = fit_camera(40.0 * fake_run.CUBE, UP, "front", PICTURE[0] / PICTURE[1])
    near, far, beside = (fake_run.CUBE + np.array(at) for at in ([0.0, -50, 0], [2.0, 50, 0], [60.0, 0, 0]))
    toward_camera = np.sign((camera.eye - camera.target)[1])
    if toward_camera > 0:
        near, far = far, near
    layers = depth_layers([near, far, beside], camera, PICTURE)
    assert len(layers) == 2
    assert set(layers[0]) == {1, 2} and layers[1] == [0]
    assert depth_layers([], camera, PICTURE) == []


def test_a_layer_shines_through_only_where_it_shows_something():
    below = np.full((4, 6, 3), 100, dtype=np.uint8)
    layer = np.empty_like(below)
    layer[:] = EMPTY
    layer[1, 2] = (200, 0, 255)
    layer[2, 3] = (255, 0, 254)
    over = lay_over(below, layer, 0.5)
    assert over[1, 2].tolist() == [150, 50, 177]
    assert over[2, 3].tolist() == [177, 50, 177]
    over[1, 2] = over[2, 3] = 100
    assert np.array_equal(over, below)
    assert lay_over(below, layer, 1.0)[1, 2].tolist() == [200, 0, 255]


def test_antialiasing_comes_nearer_to_the_truth():
    rows, columns = np.indices((480, 640)) / 4.0
    fine = (rows > 20 + 0.23 * columns) ^ (columns > 100 + 0.1 * rows)
    true = fine.reshape(120, 4, 160, 4).mean(axis=(1, 3))
    stepped = np.repeat((255 * fine[2::4, 2::4]).astype(np.uint8)[..., None], 3, axis=2)
    smooth = antialias(stepped)
    before, after = (np.abs(image[..., 0] / 255.0 - true).mean() for image in (stepped, smooth))
    assert after < 0.6 * before
    inside = (true == 0) | (true == 1)
    far = inside & (np.abs(stepped[..., 0].astype(int) - smooth[..., 0]) > 0)
    assert far.sum() < 0.02 * inside.sum()
    plain = np.full((20, 30, 3), 77, dtype=np.uint8)
    assert np.array_equal(antialias(plain), plain)


def test_light_comes_from_above():
    shades = shade(np.ones(3), np.vstack([np.eye(3), -np.eye(3)]), KEY, np.eye(3)[2])[:, 0]
    right, front, up, left, back, down = shades
    assert up > front > left > down and up > right > back
    assert shades.min() > 0.4 and shades.max() <= 1.0


def test_an_arrow_ends_at_its_tip_and_a_short_one_is_smaller():
    long, short = (arrow_outline(np.zeros(2), np.array([length, 0.0]), 2.0) for length in (50.0, 4.0))
    for outline, length in ((long, 50.0), (short, 4.0)):
        assert outline[:, 0].max() == pytest.approx(length) and outline[:, 0].min() == pytest.approx(0.0)
        assert np.array_equal(outline[outline[:, 0].argmax()], [length, 0.0])
    assert np.ptp(short[:, 1]) < np.ptp(long[:, 1])
    assert np.isfinite(arrow_outline(np.zeros(2), np.zeros(2), 2.0)).all()


def test_polygons_have_their_area():
    picture = Image.new("RGB", (40, 30))
    paint_polygon(picture, [(10.25, 5.25), (30.25, 5.25), (10.25, 25.25)], (1.0, 1.0, 1.0))
    assert np.asarray(picture)[..., 0].sum() / 255 == pytest.approx(200.0, rel=0.06)
    before = np.array(picture)
    paint_polygon(picture, [(-50, -50), (-40, -50), (-40, -20)], (1.0, 0.0, 0.0))
    assert np.array_equal(np.array(picture), before)
    assert sum(text_colour((0.1, 0.1, 0.1))) > 2 and sum(text_colour((0.9, 0.9, 0.9))) < 1


# Every pixel of the stage has a colour that was put there: by itself, Open3D 0.20 draws black and blended ones.


PALETTE = np.array([[230, 60, 40], [40, 200, 60], [50, 90, 220], [240, 220, 60], [20, 180, 190], [120, 120, 120]])
"""Neither black nor a mixture of others."""
ROUNDING = 2
"""Colours go through single precision and sRGB: a difference, of 255, that is none."""


DRAW_BALL = f"""
import sys
import numpy as np
import trimesh
from taichisoft_outputs.drawing.camera import PictureCamera, fit_camera
from taichisoft_outputs.drawing.stage import Stage

palette = np.array({PALETTE.tolist()})
ball = trimesh.creation.icosphere(subdivisions=4, radius=30.0)
corners = np.array(ball.triangles).reshape(-1, 3)
triangles = np.arange(len(corners)).reshape(-1, 3)
colours = np.repeat(palette[np.arange(len(triangles)) % len(palette)] / 255, 3, axis=0)
camera = fit_camera(corners, np.array([0.0, 0.0, 1.0]), "iso", 4 / 3)
away = ball.face_normals @ (np.asarray(camera.eye) - np.asarray(camera.target)) > 0.3 * np.linalg.norm(camera.eye)
stage = Stage((640, 480))
pictures = []
stage.put("ball", corners, triangles[away], colours)
for times in (5, 1):  # as far; the first picture is the one in which Open3D does not know where the camera is
    eye = camera.target + times * (camera.eye - camera.target)
    pictures.append(stage.image(PictureCamera(eye, camera.target, camera.up), ["ball"]))
np.save(sys.argv[1], pictures)
"""
"""A ball of 5120 triangles whose neighbours have other colours, beside EMPTY: each triangle shows its own alone."""


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    path = tmp_path_factory.mktemp("stage") / "pictures.npy"
    child = run_python(["-c", DRAW_BALL, str(path)], 300.0)
    assert not child.problem, child.problem
    return np.load(path)


def test_what_is_far_is_small_and_not_cut_off(pictures):
    """From five times the distance a 25th of the pixels, a little less as near balls are seen under larger angles."""
    far, near = (pictures != EMPTY).any(axis=3).sum(axis=(1, 2))
    assert near / far == pytest.approx(27.0, rel=0.08)


def test_no_pixel_has_a_colour_that_nobody_gave(pictures):
    picture = pictures[1]
    known = np.vstack([PALETTE, EMPTY])
    difference = np.abs(picture.astype(int)[:, :, None] - known).max(axis=3)
    unexplained = np.argwhere(difference.min(axis=2) > ROUNDING)
    assert len(unexplained) == 0, json.dumps([picture[tuple(at)].tolist() for at in unexplained[:5]])
    shown = [(difference[:, :, index] <= ROUNDING).sum() for index in range(len(known))]
    assert min(shown) > 1000, "every colour is in the picture"
