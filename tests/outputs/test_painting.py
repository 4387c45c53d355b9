"""The parts of a picture that Open3D does not draw: shadows, floor, layers, smooth edges, arrows."""

import fake_run
import numpy as np
import pytest
from PIL import Image

from taichisoft.mechanics import Plane
from taichisoft_outputs.drawing.camera import fit_camera, project
from taichisoft_outputs.drawing.drawer import antialias
from taichisoft_outputs.drawing.painting import KEY_LIGHT, arrow_outline, paint_polygon, shade, text_colour
from taichisoft_outputs.drawing.stage import EMPTY, PIXELS, SUN_RADIUS, Floor, reaches_under, shadow, square_of_plane
from taichisoft_outputs.drawing.surface_painter import depth_layers, lay_over

RIGHT, FRONT, UP = np.eye(3)
KEY = np.array(KEY_LIGHT) / np.linalg.norm(KEY_LIGHT)
SIZE = (320, 180)


def test_a_shadow_lies_beside_what_throws_it_and_grows_softer_with_height():
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


def test_silicone_throws_a_weaker_shadow_and_nothing_under_the_plane_throws_one():
    cube = fake_run.CUBE + np.array([0.0, 0.0, 10.0])
    sun = np.array([0.0, 0.0, 1.0])
    half_dark = shadow([(cube, fake_run.CUBE_FACES, 0.5)], np.zeros(3), RIGHT, FRONT, sun, 40.0)
    assert half_dark.max() == pytest.approx(0.5, abs=0.03)
    below = shadow([(cube - [0, 0, 30.0], fake_run.CUBE_FACES, 1.0)], np.zeros(3), RIGHT, FRONT, sun, 40.0)
    assert below.max() == 0.0


def test_the_floor_is_dark_under_a_body_and_fades_into_the_background():
    background = np.array([0.8, 0.8, 0.8])
    points = fake_run.CUBE + np.array([0.0, 0.0, 5.0])
    floor = Floor(Plane("floor", np.zeros(3), UP), points, background)
    camera = fit_camera(3 * points, UP, "front", SIZE[0] / SIZE[1])
    empty = np.full((180, 320, 3), 204, dtype=np.uint8)
    picture = floor.paint(empty, camera, [(points, fake_run.CUBE_FACES, 1.0)]).astype(int)
    (under, beside), _ = project(camera, np.array([[-1.0, 0.5, 0.0], [14.0, -3.0, 0.0]]), SIZE)
    dark, light = (picture[int(y), int(x), 0] for x, y in (under, beside))
    assert dark < 0.8 * light
    assert light < 195, "the floor differs from what is behind it"
    assert (picture[0] == 204).all(), "above the horizon there is none"
    assert np.abs(np.diff(picture[:, 5, 0])).max() <= 3, "and no line where it begins"
    from_below = fit_camera(points, -UP, "top", SIZE[0] / SIZE[1])
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
    camera = fit_camera(40.0 * fake_run.CUBE, UP, "front", SIZE[0] / SIZE[1])
    near, far, beside = (fake_run.CUBE + np.array(at) for at in ([0.0, -50, 0], [2.0, 50, 0], [60.0, 0, 0]))
    toward_camera = np.sign((camera.eye - camera.target)[1])
    if toward_camera > 0:
        near, far = far, near
    layers = depth_layers([near, far, beside], camera, SIZE)
    assert len(layers) == 2
    assert set(layers[0]) == {1, 2} and layers[1] == [0]
    assert depth_layers([], camera, SIZE) == []


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


def test_smooth_edges_come_nearer_to_the_true_picture_and_leave_the_rest():
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


def test_light_comes_from_above_and_no_side_is_black_or_too_bright():
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


def test_polygons_have_their_area_and_may_lie_outside_the_picture():
    picture = Image.new("RGB", (40, 30))
    paint_polygon(picture, [(10.25, 5.25), (30.25, 5.25), (10.25, 25.25)], (1.0, 1.0, 1.0))
    assert np.asarray(picture)[..., 0].sum() / 255 == pytest.approx(200.0, rel=0.06)
    before = np.array(picture)
    paint_polygon(picture, [(-50, -50), (-40, -50), (-40, -20)], (1.0, 0.0, 0.0))
    assert np.array_equal(np.array(picture), before)
    assert sum(text_colour((0.1, 0.1, 0.1))) > 2 and sum(text_colour((0.9, 0.9, 0.9))) < 1
