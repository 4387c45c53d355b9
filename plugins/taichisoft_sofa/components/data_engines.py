"""Engines that compute data of a scene from other data: places, lists of indices and values."""

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from taichisoft.errors import SceneError
from taichisoft_sofa.components.typed_values import described, flag, number, numbers, text, vector
from taichisoft_sofa.meshes.placement import placed

if TYPE_CHECKING:
    from taichisoft_sofa.tree.component import Component


def transformed_points(engine: "Component") -> np.ndarray:
    """TransformEngine: points scaled, then rotated, then translated [mm], or, inverse, the other way round."""
    points = numbers(engine, "input_position").reshape(-1, 3)
    scale = vector(engine, "scale", default=(1.0, 1.0, 1.0))
    shift = vector(engine, "translation", default=(0.0, 0.0, 0.0))
    turn = numbers(engine, "rotation", default=(0.0, 0.0, 0.0))
    if len(turn) == 4:  # a quaternion
        turn = Rotation.from_quat(turn).as_euler("xyz", degrees=True)
    if len(turn) != 3:
        raise SceneError(
            f"{described(engine)}: rotation has {len(turn)} numbers; three angles or a quaternion are needed"
        )
    if not flag(engine, "inverse", False):
        return placed(points, scale.tolist(), turn.tolist(), shift.tolist())
    back: np.ndarray = Rotation.from_euler("xyz", turn, degrees=True).inv().apply(points - shift) / scale
    return back


def mapped_values(engine: "Component") -> np.ndarray:
    """IndexValueMapper: values, with another one at some indices; where there are none yet, the default value."""
    values, indices = numbers(engine, "inputValues"), numbers(engine, "indices").astype(np.int64)
    if len(indices) and indices.max() >= len(values):
        rest = np.full(int(indices.max()) + 1 - len(values), number(engine, "defaultValue", default=1.0))
        values = np.concatenate([values, rest])
    if len(indices) and indices.min() < 0:
        raise SceneError(f"{described(engine)}: indices has {int(indices.min())}; they count from 0")
    values[indices] = number(engine, "value", default=0.0)
    return values


def chosen_values(engine: "Component") -> np.ndarray:
    """ValuesFromIndices: the values at some indices."""
    return _rows(engine, numbers(engine, "in"), 1).ravel()


def chosen_points(engine: "Component") -> np.ndarray:
    """PointsFromIndices: the points at some indices [mm]."""
    return _rows(engine, numbers(engine, "position"), 3)


def _rows(engine: "Component", values: np.ndarray, width: int) -> np.ndarray:
    rows, indices = values.reshape(-1, width), numbers(engine, "indices").astype(np.int64)
    outside = indices[(indices < 0) | (indices >= len(rows))]
    if len(outside):
        raise SceneError(f"{described(engine)}: names row {int(outside[0])}; there are {len(rows)}, from 0 on")
    return rows[indices]


SETS: dict[str, Any] = {
    "union": np.union1d,
    "intersection": np.intersect1d,
    "difference": np.setdiff1d,
    "symmetric_difference": np.setxor1d,
}


def merged_set(engine: "Component") -> np.ndarray:
    """MergeSets: what `op` makes of two sets of indices."""
    operation = text(engine, "op", default="union").lower()
    if operation not in SETS:
        raise SceneError(f"{described(engine)}: op '{operation}'; valid: {', '.join(SETS)}")
    merged: np.ndarray = SETS[operation](
        numbers(engine, "in1").astype(np.int64), numbers(engine, "in2").astype(np.int64)
    )
    return merged
