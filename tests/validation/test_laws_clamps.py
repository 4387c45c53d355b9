"""Bodies held by several frames: what each of them feels, in tension, torsion, under pressure, and in motion."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from conftest import Figures
from scenes import silicone
from scipy.spatial.transform import Rotation

from taichisoft import Control, Simulation
from taichisoft.errors import SceneError
from taichisoft.scene import scene_from_dict

LENGTH, SIDE, MODULUS = 40.0, 8.0, 100.0
BAR = (LENGTH, SIDE, SIDE)
Block = Callable[..., str]


def ends(length: float = LENGTH, **keys: Any) -> list[dict[str, Any]]:
    """Anchors of the two ends of a bar along x at the frames "left" and "right"."""
    middle, reach = length / 2, 2.0 * length
    boxes = {"left": (-reach, 1e-6 - middle), "right": (middle - 1e-6, reach)}
    return [
        {"box": [[low, -reach, -reach], [high, reach, reach]], "follows": frame, **keys}
        for frame, (low, high) in boxes.items()
    ]


def clamped(mesh: str, time: dict[str, Any] | None = None, **body: Any) -> Simulation:
    """A bar between two frames, in statics where nothing else is wanted."""
    specimen = silicone(mesh, **{"young_modulus": MODULUS, "anchors": ends(), **body})
    return Simulation(
        scene_from_dict(
            {
                "gravity": (0.0, 0.0, 0.0),
                "time": {"step": 0.01, **(time or {"dynamics": "static"})},
                "frames": {"left": {}, "right": {}},
                "soft_bodies": {"bar": specimen},
            }
        )
    )


def pull(by: float, **other: Any) -> Control:
    """The right frame moved along x [mm]."""
    return Control(frame_translation={"right": [by, 0.0, 0.0]}, **other)


def forces(simulation: Simulation) -> np.ndarray:
    """Forces [mN] on the left and on the right frame, shape (2, 3)."""
    return simulation.state.frame_wrench[1:, 0]


@pytest.mark.parametrize("element", ["linear", "smoothed", "quadratic"])
def test_an_evenly_stretched_bar_pulls_with_e_a_e(block: Block, figures: Figures, element: str) -> None:
    """With ends that may narrow, F = E A e on both frames, to the order of the strain e = 1e-4 and on any mesh."""
    strain = 1e-4
    corner = [{"nodes": [node], "follows": frame} for node, frame in ((0, "left"), (8, "left"))]
    anchors = [*ends(directions=["x"]), corner[0], {**corner[1], "directions": ["x", "z"]}]
    bar = clamped(block((8, 2, 2), BAR), element=element, anchors=anchors, poisson_ratio=0.45)
    bar.step(pull(strain * LENGTH))
    expected = MODULUS * SIDE**2 * strain
    figures.close("force on the left frame [mN]", forces(bar)[0, 0], expected, 2 * strain * expected)
    figures.close("force on the right frame [mN]", forces(bar)[1, 0], -expected, 2 * strain * expected)


def test_clamps_that_hold_the_ends_wide_make_a_bar_stiffer(block: Block, figures: Figures) -> None:
    """Above E A e and below that of a confined bar; two meshes agree, and so does a load in the place of the frame.

    That is 2.7 % between 16 x 4 x 4 and 8 x 2 x 2 cells of quadratic elements, whose corners at clamps are singular.
    """
    strain, poisson, loads = 1e-3, 0.45, []
    for cells in ((8, 2, 2), (16, 4, 4)):
        bar = clamped(block(cells, BAR), element="quadratic", poisson_ratio=poisson)
        bar.step(pull(strain * LENGTH))
        loads.append(-forces(bar)[1, 0])
    free = MODULUS * SIDE**2 * strain
    confined = free * (1.0 - poisson) / (1.0 + poisson) / (1.0 - 2.0 * poisson)
    assert free < loads[1] < confined
    figures.close("force on two meshes [of E A e]", loads[0] / free, loads[1] / free, 0.03)
    # The same bar, held at the left and loaded at the right, where the anchors keep it wide.
    end = {**ends()[1], "directions": ["y", "z"]}
    load = {"box": end["box"], "force": [loads[0], 0.0, 0.0]}
    loaded = clamped(
        block((8, 2, 2), BAR),
        element="quadratic",
        poisson_ratio=poisson,
        anchors=[ends()[0], end],
        forces=[load],
    )
    loaded.step()
    held = loaded.model.rest_position[:, 0] > LENGTH / 2 - 1e-6
    moved = (loaded.state.position - loaded.model.rest_position)[held, 0].mean()
    figures.close("elongation by a load of that force [mm]", moved, strain * LENGTH, 0.03 * strain * LENGTH)


def test_frames_that_move_as_one_feel_no_force(block: Block, figures: Figures) -> None:
    """Turned by any angle and shifted together, they leave the bar as it was: no force, and no torque."""
    bar = clamped(block((8, 2, 2), BAR), law="neo-hookean")
    turn = Rotation.from_rotvec(np.array([0.4, 1.5, -0.7]))
    shift, pivots = np.array([30.0, -5.0, 80.0]), bar.model.frames.pivot[1:].copy()
    moved = dict(zip(("left", "right"), turn.apply(pivots) - pivots + shift, strict=True))
    bar.step(Control(frame_translation=moved, frame_rotation=dict.fromkeys(moved, turn.as_rotvec())))
    assert np.abs(bar.state.position - bar.model.rest_position).max() > 50.0
    figures.at_most("force [mN]", np.abs(forces(bar)).max(), 0.05)
    figures.at_most("torque [mN mm]", np.abs(bar.state.frame_wrench[:, 1]).max(), 0.5)


def test_a_twisted_bar_has_the_torque_of_saint_venant(block: Block, figures: Figures) -> None:
    """T = G J phi / L with J = 0.14058 a^4 of a square, whose ends warp freely; 4 x 4 quadratic cells across it."""
    angle, poisson = 1e-3, 0.3
    anchors = [*ends(directions=["y", "z"]), {"nodes": [0], "follows": "left"}]
    bar = clamped(block((10, 4, 4), BAR), element="quadratic", poisson_ratio=poisson, anchors=anchors)
    bar.step(Control(frame_rotation={"right": [angle, 0.0, 0.0]}))
    expected = MODULUS / (2.0 * (1.0 + poisson)) * 0.14058 * SIDE**4 * angle / LENGTH
    left, right = bar.state.frame_wrench[1:, 1, 0]
    figures.close("torque on the right frame [of G J phi / L]", -right / expected, 1.0, 0.01)
    figures.close("torque on the left frame [of that on the right]", -left / right, 1.0, 1e-6)


@pytest.mark.parametrize(("theta", "newton"), [(1.0, 1), (1.0, 10), (0.5, 1), (0.5, 10)])
def test_mirrored_motions_mirror_what_frames_feel(block: Block, figures: Figures, theta: float, newton: int) -> None:
    """Of a mesh that its middle mirrors: x to -x turns forces, and leaves torques.

    One frame's wrench comes from the springs and the other's from the balance of momentum, which this compares.
    """
    seen = []
    for sign in (1.0, -1.0):
        bar = clamped(block((6, 2, 2), BAR), time={"theta": theta, "newton": newton, "step": 0.002}, poisson_ratio=0.4)
        moving, standing = ("right", "left") if sign > 0 else ("left", "right")
        rows = []
        for number in range(40):
            time = 0.002 * (number + 1)
            shift = sign * (1.0 - np.cos(40.0 * time)) * np.array([2.0, 0.5, 1.0])
            turn = np.array([0.2, 0.1, -0.1]) * np.sin(30.0 * time) ** 2
            gravity = sign * np.array([500.0, 0.0, -9810.0])
            report = bar.step(
                Control(frame_translation={moving: shift}, frame_rotation={moving: turn}, gravity=gravity)
            )
            truth = report.observation
            rows.append([[sign * truth.frame_forces[one], truth.frame_torques[one]] for one in (moving, standing)])
        seen.append(np.array(rows))
    scale = np.abs(seen[0]).max(axis=(0, 1, 3))
    print(scale, np.abs(seen[0] - seen[1]).max(axis=(0, 3)))
    worst = (np.abs(seen[0] - seen[1]).max(axis=(0, 1, 3)) / scale).tolist()
    # Forces on an angular momentum act where one linearisation takes them, which is not quite where the nodes end.
    figures.at_most("force [relative]", worst[0], 1e-5)
    figures.at_most("torque [relative]", worst[1], 1e-4 if newton > 1 else 0.05)


def test_soft_springs_show_the_force_of_each_frame(block: Block, figures: Figures) -> None:
    """Springs of 100 mN/mm stretch visibly: their stiffness times their stretch is what the frames feel, in motion."""
    stiffness, worst = 100.0, 0.0
    bar = clamped(block((6, 2, 2), BAR), time={"newton": 10}, anchors=ends(stiffness=stiffness))
    for number in range(30):
        bar.step(pull(0.1 * number, frame_rotation={"left": [0.02 * number, 0.0, 0.0]}))
        model, places = bar.model, bar.model.places(bar.state)
        for frame in (1, 2):
            node = model.anchored_nodes[model.anchor_frame == frame]
            stretch = bar.state.position[node] - places.moved(model.rest_position[node], frame)
            worst = max(worst, np.abs(stiffness * stretch.sum(axis=0) - forces(bar)[frame - 1]).max())
    figures.at_most("force of the springs [mN]", worst, 1e-6 * np.abs(forces(bar)).max())


def test_a_cycle_of_the_frames_returns_its_work(block: Block, figures: Figures) -> None:
    """Pulled, twisted, let back, twisted back: rubber gives back all work but the error of the trapezium's rule."""
    bar, angle, way, parts = clamped(block((6, 2, 2), BAR), law="neo-hookean"), 0.5, 6.0, 12
    corners = np.array([[0.0, 0.0], [way, 0.0], [way, angle], [0.0, angle], [0.0, 0.0]])
    path = np.vstack([np.linspace(a, b, parts, endpoint=False) for a, b in pairwise(corners)] + [corners[:1]])
    loads = []
    for shift, turn in path:
        bar.step(pull(shift, frame_rotation={"right": [turn, 0.0, 0.0]}))
        loads.append(bar.state.frame_wrench[2, :, 0])
    mean = (np.array(loads)[1:] + np.array(loads)[:-1]) / 2.0
    work = -(mean * np.diff(path, axis=0)).sum(axis=1)
    pulled = work[:parts].sum()
    assert pulled > 0.0
    figures.at_most("work of the cycle [of that of pulling]", abs(work.sum()) / pulled, 1e-3)


def test_plates_feel_pressure_on_the_effective_area(block: Block, figures: Figures) -> None:
    """Virtual work: at a distance of the plates the force rises with the pressure by dV/dx, the effective area."""
    cells, size = (4, 4, 4), (20.0, 20.0, 20.0)
    table = {"anchors": ends(20.0), "cavities": {"air": {"group": "cavity"}}, "element": "quadratic"}
    bellows = clamped(block(cells, size, hollow=True), poisson_ratio=0.3, **table)

    def at(way: float, pressure: float) -> tuple[float, float]:
        bellows.step(pull(way, pressure={"bar.air": pressure}))
        return float(forces(bellows)[1, 0]), bellows.observe().volumes["bar.air"]

    way, pressure, step = 1.0, 4.0, 0.05
    by_pressure = (at(way, pressure + step)[0] - at(way, pressure - step)[0]) / (2.0 * step)
    by_way = (at(way + step, pressure)[1] - at(way - step, pressure)[1]) / (2.0 * step)
    assert 50.0 < by_way < 400.0  # between a half of the hollow's section and the whole of the plate
    figures.close("dF/dp over dV/dx [-]", by_pressure / by_way, 1.0, 1e-3)
    figures.close("forces on both plates [mN]", float(forces(bellows).sum(axis=0)[0]), 0.0, 1e-3)


def test_a_restored_state_goes_on_with_the_same_bits(block: Block) -> None:
    bar = clamped(block((6, 2, 2), BAR), time={"newton": 3})
    for number in range(6):
        if number == 3:
            middle = bar.state
        bar.step(pull(0.5 * number, frame_rotation={"left": [0.1 * number, 0.0, 0.0]}))
    first = bar.state
    bar.restore(middle)
    for number in range(3, 6):
        bar.step(pull(0.5 * number, frame_rotation={"left": [0.1 * number, 0.0, 0.0]}))
    np.testing.assert_array_equal(bar.state.frame_wrench, first.frame_wrench)
    np.testing.assert_array_equal(bar.state.position, first.position)


def test_pivots_and_pulled_anchors_go_by_their_own_frame(block: Block) -> None:
    """The pivot of a frame is the mean of its own anchors, and requested places move with the frame of each."""
    bar = clamped(block((6, 2, 2), BAR))
    np.testing.assert_allclose(bar.model.frames.pivot, [[0, 0, 0], [-LENGTH / 2, 0, 0], [LENGTH / 2, 0, 0]], atol=1e-9)
    model = bar.model
    places = model.rest_position[model.anchored_nodes] + [0.0, 1.0, 0.0]
    bar.step(pull(2.0, anchor_positions={"bar": places}))
    moved = bar.state.position[model.anchored_nodes] - model.rest_position[model.anchored_nodes]
    expected = np.where((model.anchor_frame == 2)[:, None], [2.0, 1.0, 0.0], [0.0, 1.0, 0.0])
    np.testing.assert_allclose(moved, expected, atol=1e-6)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"anchors": [*ends(), {"nodes": [3, 0], "follows": "right"}]},
            r"soft_bodies.bar.anchors.2 holds node 0 at the frame 'right', and an anchor before it at 'left' \(2 such",
        ),
        (
            {"anchors": [{"nodes": [0], "follows": "rihgt"}]},
            "anchors.0.follows is 'rihgt', which is not a frame; there",
        ),
        (
            {"reduced": "modes.npz"},
            'soft_bodies.bar: anchors.0.follows = "left": the modes of a reduced body follow "base"; remove',
        ),
    ],
)
def test_anchors_that_cannot_be_held_so_are_refused(block: Block, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        clamped(block((6, 2, 2), BAR), **changes)
