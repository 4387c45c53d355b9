"""What is thin keeps what it presses: a tool that stops in a soft block bears what one bears that came slowly."""

import functools
import math
import tempfile
import warnings
from pathlib import Path
from typing import Any

import pytest
from blocks import make_block
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st
from scenes import silicone

from taichisoft import Simulation, write_volume_mesh
from taichisoft.scene import scene_from_dict

SIZE = (20.0, 20.0, 20.0)
GONE_INTO = "may have gone into each other"


@functools.cache
def mesh(cells: int) -> str:
    path = Path(tempfile.mkdtemp()) / "block.msh"
    write_volume_mesh(make_block((cells,) * 3, SIZE), path)
    return str(path)


def tool(kind: str, thickness: float) -> tuple[dict[str, Any], float]:
    """A tool's table, and the height of its middle over its lowest point [mm]."""
    if kind == "sheet":
        return {"box": [thickness, 30.0, 10.0]}, 5.0
    if kind == "needle":
        return {"box": [thickness, thickness, 10.0]}, 5.0
    if kind == "coin":
        return {"cylinder": {"radius": 8.0, "length": thickness}, "rotation": [0.0, 90.0, 0.0]}, 8.0
    return {"capsule": {"radius": thickness / 2, "length": 24.0}, "rotation": [90.0, 0.0, 0.0]}, thickness / 2


def force_after_stop(
    kind: str,
    thickness: float,
    speed: float,
    step: float,
    gap: float,
    depth: float,
    element: str,
    distance: float,
    dynamics: str = "inertial",
) -> float:
    """Force of a tool that a frame moves into a block, 0.4 s after it has stopped [mN]."""
    table, half = tool(kind, thickness)
    block = silicone(mesh(2), element=element, young_modulus=100, rayleigh_stiffness=0.02)
    base = [[-SIZE[0], -SIZE[1], -SIZE[2] / 2 - 0.1], [SIZE[0], SIZE[1], -SIZE[2] / 2 + 0.1]]
    duration = (gap + depth) / speed
    tables = {
        "gravity": [0.0, 0.0, 0.0],
        "time": {"step": step, "dynamics": dynamics},
        "contact": {"friction": 0.0, "contact_distance": distance, "alarm_distance": 2.0},
        "frames": {"top": {"path": {"times": [0.0, duration], "translations": [[0, 0, 0], [0, 0, -gap - depth]]}}},
        "soft_bodies": {"block": {**block, "anchors": [{"box": base}]}},
        "rigid_bodies": {
            "tool": {**table, "position": [4.2, 0.3, SIZE[2] / 2 + distance + gap + half], "follows": "top"}
        },
    }
    simulation = Simulation(scene_from_dict(tables))
    rest = 0.4 if dynamics == "inertial" else 0.0
    for _ in range(math.ceil(duration / step) + round(rest / step)):
        report = simulation.step()
    return float(-report.contact_forces[:, 2].sum()) if len(report.contact_forces) else 0.0


@functools.cache
def slow(kind: str, thickness: float, depth: float, element: str, distance: float) -> float:
    """The same of a tool that moves by 0.2 mm in a step from where it touches."""
    return force_after_stop(kind, thickness, 20.0, 0.01, 0.0, depth, element, distance)


@pytest.mark.parametrize("thickness", [0.1, 0.2, 0.3])
def test_sheet_that_stops_keeps_its_force(thickness: float) -> None:
    """At 10 mm/s and 20 ms, 0.2 mm a step: thinner sheets lost contact in the step in which they stopped."""
    kept = force_after_stop("sheet", thickness, 10.0, 0.02, 0.0, 3.0, "linear", 0.05)
    reference = force_after_stop("sheet", 2.0, 10.0, 0.02, 0.0, 3.0, "linear", 0.05)
    assert abs(kept) == pytest.approx(abs(reference), rel=0.02)  # the width adds the rest


@pytest.mark.parametrize("depth", [1.0, 3.0])
@pytest.mark.parametrize("kind", ["sheet", "needle", "coin", "wire"])
def test_slow_tool_bears_what_statics_give(kind: str, depth: float) -> None:
    """To 1e-3, in small static steps and in one: deep in, contacts turn so much that searches for them swung."""
    for step in (0.005, depth / 100.0):
        statics = force_after_stop(kind, 0.1, 100.0, step, 0.0, depth, "linear", 0.05, "static")
        assert slow(kind, 0.1, depth, "linear", 0.05) == pytest.approx(statics, rel=1e-3)


def test_contacts_that_never_settle_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """A static step whose searches for contacts still move bodies names one, and does not say that it converged."""
    monkeypatch.setattr("taichisoft.step.equilibrium_search.MOST_SEARCHES", 2)
    with pytest.warns(UserWarning, match=r"is not one: another search for contacts moves 'block' by .* mm"):
        force_after_stop("sheet", 0.1, 100.0, 0.03, 0.0, 3.0, "linear", 0.05, "static")


@examples(15)
@given(
    kind=st.sampled_from(["sheet", "needle", "coin", "wire"]),
    thickness=st.sampled_from([0.06, 0.1, 0.2, 0.5, 1.0, 2.0]),
    speed=st.sampled_from([5.0, 20.0, 60.0, 200.0, 500.0, 1000.0]),
    step=st.sampled_from([0.002, 0.005, 0.01]),
    gap=st.sampled_from([0.0, 0.5, 3.0, 7.0]),
    depth=st.sampled_from([1.0, 2.0, 3.0]),
    element=st.sampled_from(["linear", "smoothed"]),
)
def test_fast_tool_bears_what_a_slow_one_bears(
    kind: str, thickness: float, speed: float, step: float, gap: float, depth: float, element: str
) -> None:
    """To 2 %, or a warning names the bodies and the time; the block is nowhere found at rest inside the tool."""
    distance = min(0.5 * thickness, 0.1)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        force = force_after_stop(kind, thickness, speed, step, gap, depth, element, distance)
    if not any(GONE_INTO in str(one.message) for one in said):
        assert force == pytest.approx(slow(kind, thickness, depth, element, distance), rel=0.02)
