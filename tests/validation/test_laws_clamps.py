"""Bodies held by several frames: what each of them feels, in tension, torsion, under pressure, and in motion."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Figures
from scenes import silicone
from scipy.spatial.transform import Rotation

from taichisoft import Control, Force, Simulation, equilibrium, rollouts
from taichisoft.errors import SceneError
from taichisoft.scene import scene_from_dict
from taichisoft_outputs import read_recording
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.recording.resume import resumed_simulation

LENGTH, SIDE, MODULUS = 40.0, 8.0, 100.0
BAR = (LENGTH, SIDE, SIDE)
SOFT = 100.0
"""Stiffness of springs that stretch visibly [mN/mm]."""
MIDDLE = {"box": [[-1.0, -5.0, -5.0], [1.0, 5.0, -3.9]], "follows": "middle", "stiffness": SOFT}
THREAD = {"points": [[-20, 0, 0], [20, 0, 4]], "diameter": 0.1, "young_modulus": 1e5}
CONVERGED = {"newton": 30, "newton_tolerance": 1e-12}
Block = Callable[..., str]


def ends(length: float = LENGTH, **keys: Any) -> list[dict[str, Any]]:
    """Anchors of the two ends of a bar along x at the frames "left" and "right"."""
    middle, reach = length / 2, 2.0 * length
    boxes = {"left": (-reach, 1e-6 - middle), "right": (middle - 1e-6, reach)}
    return [
        {"box": [[low, -reach, -reach], [high, reach, reach]], "follows": frame, **keys}
        for frame, (low, high) in boxes.items()
    ]


def clamped(
    mesh: str, time: dict[str, Any] | None = None, frames: dict[str, Any] | None = None, **body: Any
) -> Simulation:
    """A bar between two frames, in statics and without gravity where nothing else is wanted."""
    specimen = silicone(mesh, **{"young_modulus": MODULUS, "anchors": ends(), **body})
    return Simulation(
        scene_from_dict(
            {
                "gravity": (0.0, 0.0, 0.0),
                "time": {"step": 0.01, **(time or {"dynamics": "static"})},
                "frames": frames or {"left": {}, "right": {}},
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


@pytest.mark.parametrize("element", ["linear", "smoothed", "quadratic"])
def test_a_confined_bar_has_its_modulus(block: Block, figures: Figures, element: str) -> None:
    """One cell between plates, all of its corners held: F = A e E (1 - nu) / ((1 + nu) (1 - 2 nu)), no node is free.

    Nodes in the middle of edges are held across them, as the walls of an oedometer hold them.
    """
    strain, poisson, side = 1e-4, 0.3, (10.0, 10.0, 10.0)
    walls = {"box": [[-6.0] * 3, [6.0] * 3], "directions": ["y", "z"], "follows": "left"}
    halves = [{**walls, "box": [[-6.0] * 3, [-1e-6, 6.0, 6.0]]}, {**walls, "box": [[1e-6, -6.0, -6.0], [6.0] * 3]}]
    halves[1]["follows"] = "right"
    middle = [{**walls, "box": [[-1e-6, -6.0, -6.0], [1e-6, 6.0, 6.0]]}] if element == "quadratic" else []
    held = clamped(
        block((1, 1, 1), side), element=element, anchors=[*halves, *middle, *ends(10.0)], poisson_ratio=poisson
    )
    held.step(pull(strain * side[0]))
    confined = MODULUS * (1.0 - poisson) / (1.0 + poisson) / (1.0 - 2.0 * poisson) * side[1] * side[2] * strain
    figures.close("force on the right frame [mN]", -forces(held)[1, 0], confined, 2 * strain * confined)


def test_frames_at_rest_feel_equal_and_opposite_forces(block: Block, figures: Figures) -> None:
    """Pulled, twisted and at rest again: forces add up to nothing, and torques about one point do, to round-off."""
    bar = clamped(block((8, 2, 2), BAR), time={"newton": 4}, law="neo-hookean")
    turn = {"left": [0.3, 0.1, 0.0], "right": [0.0, 0.0, 0.8]}
    for number in range(300):
        bar.step(pull(10.0 * min(number / 30, 1.0), frame_rotation=turn if number else {}))
    seen = bar.observe()
    places = {"left": [-LENGTH / 2, 0.0, 0.0], "right": [LENGTH / 2 + 10.0, 0.0, 0.0]}
    about = sum(seen.frame_torques[name] + np.cross(place, seen.frame_forces[name]) for name, place in places.items())
    assert seen.frame_forces["left"][0] > 1000.0
    figures.at_most("sum of the forces [mN]", np.abs(forces(bar).sum(axis=0)).max(), 1e-9)
    figures.at_most("sum of the torques [mN mm]", np.abs(about).max(), 1e-6)


@pytest.mark.parametrize("newton", [1, 30])
def test_frames_share_a_force_on_the_bar(block: Block, figures: Figures, newton: int) -> None:
    """In its middle each bears half, at a held corner that frame bears all."""
    bar = clamped(block((8, 2, 2), BAR), time={"dynamics": "static", "newton": newton})
    for where, share in ((0.0, 3.0), (LENGTH / 2, 6.0)):
        bar.step(Control(forces={"bar": Force([0.0, 0.0, 6.0], point=[where, 0.0, 0.0])}))
        figures.close(f"force on the right frame, pushed at x = {where:g} mm [mN]", forces(bar)[1, 2], share, 1e-3)
        figures.close("sum of both [mN]", forces(bar)[:, 2].sum(), 6.0, 1e-9)


def test_what_carries_both_frames_feels_nothing_of_the_pull(block: Block, figures: Figures) -> None:
    """Jaws on a hand: the base feels the weight of the bar alone, by which their forces differ."""
    bar = clamped(block((6, 2, 2), BAR), frames={"left": {"follows": "base"}, "right": {"follows": "base"}})
    bar.step(pull(4.0, gravity=np.array([0.0, 0.0, -9810.0])))
    weight = -9810e-6 * np.prod(BAR)
    assert forces(bar)[0, 0] > 100.0
    figures.close("force on the base [mN]", np.abs(bar.observe().base_force - [0.0, 0.0, weight]).max(), 0.0, 1e-9)


def test_peeling_shows_the_bending_stiffness_of_the_strip(block: Block, figures: Figures) -> None:
    """As of a double cantilever beam (ASTM D5528): the cube root of the compliance is linear in the free length a.

    The strip is stuck to a plate by its lower side, and its end lifted without turning: C = (a + c)^3 / (12 E I), and
    the torque is that of a force at half of a + c. The constant c is what gives way in the seam; shear leaves 2 %.
    """
    size, lift, free = (60.0, 4.0, 2.0), 0.01, np.array([20.0, 30.0, 40.0])
    roots, lever = [], []
    for length in free:
        stuck = {"box": [[-40.0, -4.0, -2.0], [30.0 - length, 4.0, -1.0 + 1e-6]], "follows": "left"}
        strip = clamped(block((30, 2, 1), size), element="quadratic", anchors=[stuck, ends(60.0)[1]])
        seen = strip.step(Control(frame_translation={"right": [0.0, 0.0, lift]})).observation
        force, torque = -seen.frame_forces["right"][2], -seen.frame_torques["right"][1]
        roots.append((lift / force) ** (1.0 / 3.0))
        lever.append(2.0 * abs(torque) / force)
    slope = (roots[2] - roots[0]) / (free[2] - free[0])
    inertia = size[1] * size[2] ** 3 / 12.0
    figures.close("Young's modulus [kPa]", 1.0 / (12.0 * inertia * slope**3), MODULUS, 0.03 * MODULUS)
    figures.close("middle of the line [relative]", 0.5 * (roots[0] + roots[2]) / roots[1], 1.0, 2e-3)
    figures.at_most("lever by the torque [mm]", np.abs(np.array(lever) - np.array(roots) / slope).max(), 0.2)


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
    figures.at_most("force [mN]", np.abs(forces(bar)).max(), 1e-5)
    figures.at_most("torque [mN mm]", np.abs(bar.state.frame_wrench[:, 1]).max(), 1e-4)


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

    One frame's wrench comes from the equations of its nodes and the other's from the balance of momentum, which this
    compares. Without damping, whose forces are those of the first linearisation and turn with nothing.
    """
    seen = []
    for sign in (1.0, -1.0):
        bar = clamped(
            block((6, 2, 2), BAR),
            time={"theta": theta, "newton": newton, "step": 0.002},
            poisson_ratio=0.4,
            rayleigh_stiffness=0.0,
        )
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
    worst = (np.abs(seen[0] - seen[1]).max(axis=(0, 1, 3)) / scale).tolist()
    # Forces turn angular momentum where one linearisation has them, which is not quite where the nodes end.
    figures.at_most("force [relative]", worst[0], 1e-7)
    figures.at_most("torque [relative]", worst[1], 1e-4 if newton > 1 else 0.05)


@pytest.mark.parametrize(
    ("time", "body"),
    [
        ({"newton": 10}, {}),
        ({"newton": 1}, {"element": "linear", "rayleigh_mass": 5.0}),
        ({"newton": 1}, {"law": "neo-hookean"}),
        ({"newton": 1}, {"element": "quadratic", "law": "neo-hookean"}),
        ({"dynamics": "overdamped", "step": 0.001}, {}),
        ({"dynamics": "static"}, {"law": "neo-hookean"}),
        ({"newton": 1}, {"fibres": {"thread": THREAD}}),
        ({"newton": 1}, {"cables": {"tendon": {"points": [[-20, 1, 1], [20, 1, 1]]}}}),
        ({"newton": 1}, {"forces": [{"box": [[19, -5, -5], [21, 5, 5]], "force": [0.0, 50.0, 0.0]}]}),
        ({"newton": 1}, {"anchors": [*ends(stiffness=SOFT), MIDDLE]}),
    ],
)
def test_soft_springs_show_the_force_of_each_frame(
    block: Block, figures: Figures, time: dict[str, Any], body: dict[str, Any]
) -> None:
    """Springs of 100 mN/mm stretch visibly: their stiffness times their stretch is what the frames feel, in motion."""
    worst, frames = 0.0, {"left": {}, "right": {}, "middle": {}}
    bar = clamped(block((6, 2, 2), BAR), time, frames, **{"anchors": ends(stiffness=SOFT), **body})
    tension = {"cable_tension": {"bar.tendon": 200.0}} if "cables" in body else {}
    gravity = np.array([0.0, 500.0, -9810.0])
    for number in range(30):
        turned = {"left": [0.02 * number, 0.0, 0.0]}
        bar.step(pull(0.1 * number, frame_rotation=turned, gravity=gravity, **tension))
        model, places = bar.model, bar.model.places(bar.state)
        for frame in (1, 2, 3):
            node = model.anchored_nodes[model.anchor_frame == frame]
            stretch = bar.state.position[node] - places.moved(model.rest_position[node], frame)
            worst = max(worst, np.abs(SOFT * stretch.sum(axis=0) - forces(bar)[frame - 1]).max())
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
    figures.close("dF/dp over dV/dx [-]", by_pressure / by_way, 1.0, 1e-5)
    figures.close("forces on both plates [mN]", float(forces(bellows).sum(axis=0)[0]), 0.0, 1e-9)


@pytest.mark.parametrize("newton", [1, 3])
def test_recordings_and_rollouts_repeat_the_bits(block: Block, tmp_path: Path, newton: int) -> None:
    """What goes on from the middle of a recording, and a future of that state on other threads."""
    bar = clamped(block((6, 2, 2), BAR), time={"newton": newton})
    controls = [pull(0.5 * number, frame_rotation={"left": [0.1 * number, 0.0, 0.0]}) for number in range(6)]
    output = RecordingOutput(tmp_path)
    output.begin(bar.model, bar.state)
    for control in controls:
        report = bar.step(control)
        output.record(bar.state, report)
    output.end("completed")
    with read_recording(tmp_path / "recording.h5") as recording:
        seen = recording.column("frame_wrench")
        np.testing.assert_array_equal(seen[-1], bar.state.frame_wrench)
        resumed = resumed_simulation(recording, 3, recording.scene)
    futures = rollouts(resumed, [controls[3:]], 2, ["frame_forces.left", "frame_forces.right"])
    both = [futures["frame_forces.left"][0, -1], futures["frame_forces.right"][0, -1]]
    for control in controls[3:]:
        resumed.step(control)
    resumed.close()
    assert resumed.state == bar.state
    np.testing.assert_array_equal(both, forces(bar))


@pytest.mark.parametrize("time", [{"newton": 1}, CONVERGED], ids=["linear", "converged"])
@pytest.mark.parametrize("holds", ["left", "right"])
def test_derivatives_of_the_forces_are_their_differences(
    block: Block, figures: Figures, time: dict[str, Any], holds: str
) -> None:
    """By the base, which holds one end, and by the pressure: against differences of steps, which are nearly linear."""
    anchors = ends(20.0)
    anchors[0 if holds == "left" else 1]["follows"] = "base"
    air = {"cavities": {"air": {"group": "cavity"}}, "poisson_ratio": 0.3}
    mesh = block((4, 4, 4), (20.0, 20.0, 20.0), hollow=True)
    bellows = clamped(mesh, time=time, law="neo-hookean", anchors=anchors, **air)
    turned = {"base_translation": [0.2, 0.0, 0.0], "base_rotation": [0.0, 0.03, 0.0]}
    for _ in range(3):
        bellows.step(Control(pressure={"bar.air": 3.0}, **turned))
    start, half = bellows.state, 1e-4
    names = {"base_translation.x": "base_translation", "base_rotation.y": "base_rotation"}
    linear = bellows.linearise(Control(pressure={"bar.air": 3.0}, **turned), [*names, "pressure.bar.air"])
    for column, changed in enumerate([*names.values(), "pressure"]):
        loads = []
        for sign in (1.0, -1.0):
            bellows.restore(start)
            request: dict[str, Any] = {"pressure": {"bar.air": 3.0}, **turned}
            if changed == "pressure":
                request["pressure"] = {"bar.air": 3.0 + sign * half}
            else:
                axis = 0 if changed == "base_translation" else 1
                request[changed] = np.array(request[changed]) + sign * half * np.eye(3)[axis]
            loads.append(bellows.step(Control(**request)).observation.base_force)
        expected = (loads[0] - loads[1]) / (2.0 * half)
        error = np.abs(linear["base_force"][:, column] - expected).max() / np.abs(expected).max()
        figures.at_most(f"derivative by {changed} [relative]", error, 1e-6)


def test_an_equilibrium_is_where_statics_end(block: Block, figures: Figures) -> None:
    """Of a moving bar: the same forces as of the model of static dynamics, and no inertia in them."""
    moving, static = (clamped(block((6, 2, 2), BAR), time=time) for time in ({"step": 0.01}, {"dynamics": "static"}))
    control = pull(3.0, frame_rotation={"left": [0.0, 0.2, 0.0]})
    moving.step(control)
    static.step(control)
    rest = equilibrium(moving, control).observation
    np.testing.assert_allclose(rest.frame_forces["right"], forces(static)[1], atol=1e-3)
    figures.at_most("sum [mN]", np.abs(rest.frame_forces["right"] + rest.frame_forces["left"]).max(), 1e-9)


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
        ({"anchors": [{"nodes": [0], "follows": ""}]}, "anchors.0.follows is '', which is not a frame; there"),
        ({"anchors": [{"nodes": [0], "follows": ["left"]}]}, r"anchors.0.follows"),
        (
            {"anchors": [{"nodes": [0], "folows": "left"}]},
            "soft_bodies.bar.anchors.0.folows: unknown key; did you mean 'follows'",
        ),
        (
            {"reduced": "modes.npz"},
            'soft_bodies.bar: anchors.0.follows = "left": the modes of a reduced body follow "base"; remove',
        ),
    ],
)
def test_anchors_that_cannot_be_held_so_are_refused(
    block: Block, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changes: dict[str, Any], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "modes.npz").touch()
    with pytest.raises(SceneError, match=message):
        clamped(block((6, 2, 2), BAR), **changes)
