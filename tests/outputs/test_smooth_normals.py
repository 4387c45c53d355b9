"""Edges stay sharp and curved faces are smooth."""

import fake_run
import numpy as np
import trimesh

from taichisoft_outputs.drawing.painting import KEY_LIGHT, SmoothNormals, shade
from taichisoft_outputs.drawing.stage import EMPTY

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
