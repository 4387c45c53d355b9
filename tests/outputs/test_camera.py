"""The camera sees everything, and stands no further away than needed."""

import numpy as np
import pytest

from taichisoft_outputs.drawing.camera import MARGIN, VERTICAL_ANGLE, VIEW_DIRECTIONS, fit_camera, scene_axes


def project(camera, points, aspect):
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
    seen, depth = project(fit_camera(points, np.array(up, float), view, aspect), points, aspect)
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
