"""Bodies that overlap at the start are refused wherever their vertices are; bodies that touch are not."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from taichisoft import Model, make_model
from taichisoft.errors import SceneError
from taichisoft.scene import scene_from_dict


def box(size: list[float], position: list[float], rotation: tuple[float, float, float] = (0, 0, 0)) -> dict[str, Any]:
    return {"box": size, "mass": 1, "position": position, "rotation": list(rotation)}


def model(**bodies: dict[str, Any]) -> Model:
    return make_model(scene_from_dict({"rigid_bodies": bodies}))


CROSSED = {
    "bars of one section": (box([40, 4, 4], [0, 0, 0]), box([4, 40, 4], [0, 0, 0])),
    "bars of two sections": (box([40, 4, 4], [0, 0, 0]), box([6, 40, 6], [0, 0, 0])),
    "a rod through a plate": (box([2, 2, 30], [3, 1, 0]), box([40, 40, 1], [0, 0, 0])),
    "one body twice": (box([10, 10, 10], [0, 0, 0]), box([10, 10, 10], [0, 0, 0])),
    "bars that cut by 0.01 mm": (box([40, 4, 4], [0, 0, 0]), box([4, 40, 4], [0, 0, 3.99])),
}


@pytest.mark.parametrize(("first", "second"), CROSSED.values(), ids=CROSSED.keys())
def test_crossed_bodies_are_refused(first: dict[str, Any], second: dict[str, Any]) -> None:
    """No vertex of one lies inside the other; the error names both and a place on the surfaces of both."""
    with pytest.raises(SceneError, match=r"^bodies 'first' and 'second' overlap at the start: .* mm; move one of"):
        model(first=first, second=second)


def test_the_place_of_the_crossing_is_told() -> None:
    with pytest.raises(SceneError, match=r"their surfaces cross at \[[24]\.0, [02]\.0, -?0\.5\] mm"):
        model(rod=box([2, 2, 30], [3, 1, 0]), plate=box([40, 40, 1], [0, 0, 0]))


TOUCHING = {
    "face on face": (box([10, 10, 10], [0, 0, 0]), box([10, 10, 10], [0, 0, 10])),
    "part of a face": (box([10, 10, 10], [0, 0, 0]), box([10, 10, 10], [3, 4, 10])),
    "edge on edge, in line": (box([10, 10, 10], [0, 0, 0]), box([10, 10, 10], [10, 0, 10])),
    "bar across bar": (box([40, 4, 4], [0, 0, 0]), box([4, 40, 4], [0, 0, 4])),
}


@pytest.mark.parametrize(("first", "second"), TOUCHING.values(), ids=TOUCHING.keys())
def test_bodies_that_touch_are_not_refused(first: dict[str, Any], second: dict[str, Any]) -> None:
    model(first=first, second=second)


@pytest.mark.parametrize(("gap", "overlaps"), [(1e-4, False), (-0.01, True)])
def test_ridge_across_ridge(gap: float, overlaps: bool) -> None:
    """Two bars stand on their edges, half the diagonal of the section high; the upper one lies across the lower."""
    height = 2 * 2 * np.sqrt(2) + gap
    lower, upper = box([40, 4, 4], [0, 0, 0], (45, 0, 0)), box([4, 40, 4], [0, 0, height], (0, 45, 0))
    if overlaps:
        with pytest.raises(SceneError, match="overlap at the start"):
            model(lower=lower, upper=upper)
    else:
        model(lower=lower, upper=upper)


def test_a_rod_through_a_ring_is_not_refused(tmp_path: Path) -> None:
    """Their boxes overlap, they do not."""
    trimesh.creation.torus(10, 2).export(tmp_path / "ring.obj")
    model(rod=box([4, 4, 40], [0, 0, 0]), ring={"surface": str(tmp_path / "ring.obj"), "mass": 1})


def test_a_rod_through_a_soft_plate_and_through_a_table_without_sides_is_refused(
    block: Callable[..., str], tmp_path: Path
) -> None:
    plate = {"mesh": block((2, 2, 1), (40.0, 40.0, 2.0)), "mass": 1, "young_modulus": 500, "poisson_ratio": 0.3}
    corners = [[-20, -20, 0], [20, -20, 0], [20, 20, 0], [-20, 20, 0]]
    trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]]).export(tmp_path / "table.obj")
    rod = {"rigid_bodies": {"rod": box([2, 2, 30], [7, 3, 0])}}
    for others in (
        {"soft_bodies": {"plate": plate}},
        {"obstacles": {"plate": {"surface": str(tmp_path / "table.obj")}}},
    ):
        with pytest.raises(SceneError, match=r"^bodies '(plate|rod)' and '(plate|rod)' overlap at the start"):
            make_model(scene_from_dict({**rod, **others}))
