"""Every pixel of the stage has a colour that was put there: by itself, Open3D 0.20 draws black and blended ones."""

import json
import sys

import numpy as np
import pytest

from taichisoft.base import run_python

PALETTE = np.array([[230, 60, 40], [40, 200, 60], [50, 90, 220], [240, 220, 60], [20, 180, 190], [120, 120, 120]])
"""Neither black nor a mixture of others."""
ROUNDING = 2
"""Colours go through single precision and sRGB: a difference, of 255, that is none."""


def draw(path):
    """A ball of 5120 triangles whose neighbours have other colours, beside EMPTY: each triangle shows its own alone."""
    import trimesh

    from taichisoft_outputs.drawing.camera import fit_camera
    from taichisoft_outputs.drawing.stage import Stage

    ball = trimesh.creation.icosphere(subdivisions=4, radius=30.0)
    corners = np.array(ball.triangles).reshape(-1, 3)
    triangles = np.arange(len(corners)).reshape(-1, 3)
    colours = np.repeat(PALETTE[np.arange(len(triangles)) % len(PALETTE)] / 255, 3, axis=0)
    camera = fit_camera(corners, np.array([0.0, 0.0, 1.0]), "iso", 4 / 3)
    away = ball.face_normals @ (np.asarray(camera.eye) - np.asarray(camera.target)) > 0.3 * np.linalg.norm(camera.eye)
    stage = Stage((640, 480))
    stage.put("ball", corners, triangles[away], colours)
    np.save(path, stage.image(camera, ["ball"]))


@pytest.fixture(scope="module")
def picture(tmp_path_factory):
    path = tmp_path_factory.mktemp("stage") / "picture.npy"
    child = run_python([__file__, str(path)], 300.0)
    assert not child.problem, child.problem
    return np.load(path)


def test_no_pixel_has_a_colour_that_nobody_gave(picture):
    from taichisoft_outputs.drawing.stage import EMPTY

    known = np.vstack([PALETTE, EMPTY])
    difference = np.abs(picture.astype(int)[:, :, None] - known).max(axis=3)
    unexplained = np.argwhere(difference.min(axis=2) > ROUNDING)
    assert len(unexplained) == 0, json.dumps([picture[tuple(at)].tolist() for at in unexplained[:5]])
    shown = [(difference[:, :, index] <= ROUNDING).sum() for index in range(len(known))]
    assert min(shown) > 1000, "every colour is in the picture"


if __name__ == "__main__":
    draw(sys.argv[1])
