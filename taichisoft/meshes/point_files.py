"""Lists of points in files: JSON, or lines of text."""

import json
from pathlib import Path

import numpy as np

from taichisoft.errors import MeshError

POINT_SUFFIXES = (".json", ".csv")


def read_points(path: str | Path) -> np.ndarray:
    """Read points [mm], shape (point_count, 3).

    A .json file is a list of [x, y, z]; a .csv file has a line with x, y, z for each point, after `#` a comment.

    Raises:
        MeshError: the file cannot be read, or is not a list of points with three finite coordinates.
    """
    path = Path(path)
    try:
        if path.suffix.lower() == ".json":
            points = np.array(json.loads(path.read_text(encoding="utf-8")), dtype=np.float64)
        else:
            points = np.loadtxt(path, delimiter=",", ndmin=2)
    except (OSError, ValueError, TypeError, RecursionError, OverflowError) as error:
        raise MeshError(f"{path}: cannot be read as a list of points: {error}") from error
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise MeshError(f"{path}: must be a list of points with three finite coordinates each, such as [[0, 0, 5]]")
    return points
