"""Draws one small picture, to see whether this machine can: `python -m taichisoft_plugins.picture_check`."""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from taichisoft_plugins.camera import fit_camera
from taichisoft_plugins.stage import Stage

TETRAHEDRON = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0], [0.0, 0.0, 10.0]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
SIZE = (160, 90)


def main() -> None:
    """Exit code 0 when a tetrahedron was drawn and can be seen."""
    up = np.array([0.0, 0.0, 1.0])
    try:
        stage = Stage(SIZE, up)
        import open3d  # after Stage, which chooses the way of drawing

        stage.add("tetrahedron", TETRAHEDRON, FACES, "rigid")
        with TemporaryDirectory() as folder:
            path = Path(folder) / "picture.png"
            stage.draw(fit_camera(TETRAHEDRON, up, "iso", SIZE[0] / SIZE[1]), path)
            picture = np.asarray(open3d.io.read_image(str(path)))
    except (ImportError, OSError, RuntimeError) as error:
        sys.exit(str(error))
    if np.ptp(picture.astype(int)) < 50:
        sys.exit("the picture is blank")


if __name__ == "__main__":
    main()
