"""Draws one small picture, to see whether this machine can: `python -m taichisoft_plugins.doctor.picture_check`."""

import sys

import numpy as np

from taichisoft_plugins.drawing.camera import fit_camera, scene_axes
from taichisoft_plugins.drawing.shading import SmoothNormals, shade
from taichisoft_plugins.drawing.stage import EMPTY, Stage

TETRAHEDRON = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0], [0.0, 0.0, 10.0]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
SIZE = (160, 90)


def main() -> None:
    """Exit code 0 when a tetrahedron was drawn and can be seen."""
    up = np.array([0.0, 0.0, 1.0])
    corners, normals = SmoothNormals(FACES)(TETRAHEDRON)
    colours = shade(np.array([0.2, 0.4, 0.8]), normals, scene_axes(up))
    try:
        stage = Stage(SIZE)
        stage.put("tetrahedron", corners, np.arange(len(corners)).reshape(-1, 3), colours)
        picture = stage.image(fit_camera(TETRAHEDRON, up, "iso", SIZE[0] / SIZE[1]), ["tetrahedron"])
    except (ImportError, OSError, RuntimeError) as error:
        sys.exit(str(error))
    if (picture == EMPTY).all():
        sys.exit("the picture is blank")


if __name__ == "__main__":
    main()
