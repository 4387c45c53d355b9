"""Engines that compute data of a scene."""

from typing import Any

import numpy as np
import pytest

from taichisoft.errors import SceneError
from taichisoft_sofa.tree.node import Node


def engine(kind: str, **data: Any) -> Any:
    return Node("root").addObject(kind, name="engine", **data)


@pytest.mark.parametrize("turn", [[0, 0, 90], [0, 0, np.sqrt(0.5), np.sqrt(0.5)]])
def test_points_are_scaled_then_turned_then_shifted(turn: list[float]) -> None:
    """And the inverse undoes it."""
    how = {"translation": [10, 0, 0], "rotation": turn, "scale": [2, 3, 1]}
    there = engine("TransformEngine", input_position=[[1, 0, 0], [0, 1, 5]], **how).output_position.value
    assert np.array(there) == pytest.approx(np.array([[10, 2, 0], [7, 0, 5]]), abs=1e-12)
    back = engine("TransformEngine", input_position=there, inverse=True, **how).output_position.value
    assert np.array(back) == pytest.approx(np.array([[1, 0, 0], [0, 1, 5]]), abs=1e-12)


def test_lists_of_values_and_indices() -> None:
    mapper = engine("IndexValueMapper", inputValues=[1, 2], indices=[0, 3], value=9, defaultValue=5)
    assert list(mapper.outputValues.value) == [9, 2, 5, 9]
    assert list(engine("ValuesFromIndices", **{"in": [4, 5, 6], "indices": [2, 0]}).out.value) == [6, 4]
    assert np.array(engine("PointsFromIndices", position=np.eye(3), indices=[2]).indices_position.value).tolist() == [
        [0, 0, 1]
    ]
    for operation, merged in {"union": [1, 2, 3], "intersection": [2], "difference": [1]}.items():
        assert list(engine("MergeSets", in1=[1, 2], in2=[2, 3], op=operation).out.value) == merged


@pytest.mark.parametrize(
    ("kind", "data", "output", "message"),
    [
        ("TransformEngine", {"input_position": [[0, 0, 0]], "rotation": [1, 2]}, "output_position", "has 2 numbers"),
        (
            "PointsFromIndices",
            {"position": [[0, 0, 0]], "indices": [1]},
            "indices_position",
            "names row 1; there are 1",
        ),
        ("MergeSets", {"in1": [1], "op": "join"}, "out", "op 'join'; valid: union, intersection"),
    ],
)
def test_mistakes_are_one_line(kind: str, data: dict[str, Any], output: str, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        getattr(engine(kind, **data), output).value  # noqa: B018


def test_a_link_to_what_a_device_has_not_sent_is_no_value() -> None:
    """SOFA's default holds where nothing has been written: no points, here of an object of points."""
    root = Node("root")
    root.addObject("CommunicationController", name="receiver", job="receiver", nbDataField=1)
    state = root.addObject("MechanicalObject", name="points", position="@receiver.data1")
    assert len(state.position.value) == 0
