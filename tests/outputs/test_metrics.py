"""The output "metrics": its figures from made-up steps of a cube that is lifted, slips, creeps, or falls."""

import json
import re
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import fake_run
import numpy as np
import pytest

from taichisoft import Observation, Scene
from taichisoft.errors import GoalMissed, TaichisoftError
from taichisoft.mechanics import ActuatorNames
from taichisoft_outputs.metrics import MetricsOutput

STEP = 0.1
LIFT = 30.0
UP = np.array([0.6, 0.0, 0.8])
"""Against gravity: lift is counted along it, whatever axis that is."""


def model(goal: bool = True) -> Any:
    scene = Scene.model_validate(
        {
            "gravity": (-9810.0 * UP).tolist(),
            "time": {"step": STEP},
            "goal": {"object": "cube", "hold": 2.0, "tolerance": 1.0, "creep": 0.1} if goal else None,
            "obstacles": {"floor": {"plane": {"point": (-20.0 * UP).tolist(), "normal": UP.tolist()}}},
            "soft_bodies": {
                name: {"mesh": "m", "mass": 1.0, "young_modulus": 500.0, "poisson_ratio": 0.3}
                for name in ("finger1", "finger2")
            },
            "rigid_bodies": {name: {"box": [10, 10, 10], "mass": 0.001} for name in ("other", "cube")},
        }
    )
    names = ActuatorNames({"cavity": (), "cable": ()})
    return SimpleNamespace(scene=scene, soft_bodies=(), frames=fake_run.frames_of(np.zeros(3)), actuators=names)


def report(step: int, **changes: Any) -> Any:
    values: dict[str, Any] = {
        "time": (step + 1) * STEP,
        "step_time": 0.020 + 0.001 * step,
        "iterations": step,
        "converged": True,
        "max_penetration": 0.01,
        "inverted_elements": 0,
        "linearisations": 1,
        "newton_residual": None,
    }
    seen = {
        "normal_forces": {
            ("finger1", "cube"): 30.0,
            ("cube", "finger2"): 20.0,
            ("cube", "floor"): 500.0 if step < 2 else 0.0,  # before the base moves
            ("finger1", "finger2"): 900.0,
            ("finger1", "floor"): 700.0,
        },
        "peak_pressures": {},
        "bending_angles": {},
        "peak_pressure_errors": {},
    }
    seen |= {name: changes.pop(name) for name in seen if name in changes}
    return SimpleNamespace(**{**values, **changes}, observation=Observation((step + 1) * STEP, step, **seen))


def state(height_of_base: float, height_of_cube: float, **contacts: Any) -> Any:
    made_up = SimpleNamespace(
        base_translation=height_of_base * UP,
        rigid_position=np.array([np.zeros(3), np.array([5.0, 6.0, 7.0]) + height_of_cube * UP]),
        time=0.0,
        contact_body_pair=np.zeros((0, 2), dtype=int),
    )
    vars(made_up).update(contacts)
    return made_up


def follow(
    folder: Path,
    base: list[float],
    cube: list[float],
    outcome: str = "completed",
    goal: bool = True,
    changes: dict[int, dict[str, Any]] | None = None,
) -> dict[str, Any]:
    """Metrics of a run whose base and cube are at the given heights [mm] before the first and after each step."""
    output = watch(folder, base, cube, goal, changes)
    try:
        output.end(outcome)
    finally:
        output.summary()
    return json.loads((folder / "metrics.json").read_text())


def watch(
    folder: Path,
    base: list[float],
    cube: list[float],
    goal: bool = True,
    changes: dict[int, dict[str, Any]] | None = None,
) -> MetricsOutput:
    """The output of such a run that has not ended yet."""
    output = MetricsOutput(folder)
    output.begin(model(goal), state(base[0], cube[0]))
    for step, heights in enumerate(zip(base[1:], cube[1:], strict=True)):
        output.record(state(*heights), report(step, **(changes or {}).get(step, {})))
    return output


RISE = [0.0, 0.0, 0.0, 10.0, 20.0]
"""Two steps of rest, then the base moves."""
HOLD = [LIFT] * 21


def cube_heights(sunk: float = -2.0, slip: float = 0.5, creep: float = 0.05) -> list[float]:
    """Settles while the fingers close, then rises with the base less a slip, and creeps while it is held."""
    rising = [sunk + (max(0.0, height - slip) if height > 0.0 else 0.0) for height in RISE]
    held = sunk + LIFT - slip
    return [0.0, *rising[1:], *np.linspace(held, held - creep, len(HOLD)).tolist()]


def test_lift_slip_and_creep_are_measured(tmp_path: Path) -> None:
    """Lift counts from the moment before the base moves: that the cube settled by 2 mm before is not slip."""
    metrics = follow(tmp_path, RISE + HOLD, cube_heights(slip=0.5, creep=0.05))
    assert metrics["held"] is True
    assert metrics["base_lift_mm"] == pytest.approx(LIFT)
    assert metrics["object_lift_mm"] == pytest.approx(LIFT - 0.5 - 0.05)
    assert metrics["object_slip_mm"] == pytest.approx(0.55)
    assert metrics["object_creep_mm"] == pytest.approx(0.05)


def test_lagging_fingers_do_not_count_as_slip(tmp_path: Path) -> None:
    """It rises by 2 mm less than the base, and so do the fingers: against them it slides down by 0.3 mm alone.

    Three quarters of the normal force are on a finger on which it slides by 0.4 mm, on the other it does not.
    """
    output = MetricsOutput(tmp_path)
    output.begin(model(), state(0.0, 0.0))
    heights = [*RISE[1:], *HOLD]
    for step, height in enumerate(heights):
        contacts = {
            "time": (step + 1) * STEP,
            "contact_body_pair": np.array([[0, 3], [3, 1]]),  # of finger1 and cube, and of cube and finger2
            "contact_normal": np.array([[0.0, 1.0, 0.0], [0.0, 1.0, 0.0]]),
            "contact_impulse": np.array([[0.1, 3.0, 0.2], [0.0, 1.0, 0.0]]),
            "contact_slip": np.array([-0.4 / STEP * UP, 0.0 * UP]) if step == 5 else np.zeros((2, 3)),
        }
        output.record(state(height, height * (1.0 - 2.0 / LIFT), **contacts), report(step))
    output.end("completed")
    assert output.metrics["object_slip_mm"] == pytest.approx(0.3)
    assert output.metrics["object_lift_mm"] == pytest.approx(LIFT - 2.0)
    assert output.metrics["held"] is True


def test_file_has_figures_of_the_steps(tmp_path: Path) -> None:
    changes = {
        3: {"converged": False, "iterations": 999},
        5: {"max_penetration": 0.25},
        7: {"normal_forces": {("finger1", "cube"): 70.0, ("cube", "finger2"): 50.0}},
    }
    metrics = follow(tmp_path, RISE + HOLD, cube_heights(), changes=changes)
    count = len(RISE + HOLD) - 1
    assert metrics["outcome"] == "completed"
    assert (metrics["steps"], metrics["simulated_time_s"]) == (count, pytest.approx(count * STEP))
    assert metrics["unconverged_steps"] == 1
    assert metrics["iterations_max"] == 999
    assert metrics["max_penetration_mm"] == 0.25
    assert metrics["peak_normal_force_mN"] == 120.0  # of the fingers on the cube: neither the floor nor each other
    assert metrics["mean_normal_force_mN"] == pytest.approx((19 * 50.0 + 120.0) / 20)
    of_fingers = {"finger1": (19 * 30.0 + 70.0) / 20, "finger2": (19 * 20.0 + 50.0) / 20}
    assert metrics["mean_normal_forces_mN"] == pytest.approx(of_fingers)
    median = 20.0 + (count - 1) / 2
    assert metrics["step_time_median_ms"] == pytest.approx(median, rel=1e-3)
    assert metrics["real_time_factor"] == pytest.approx(1e3 * STEP / median, rel=1e-3)


@pytest.mark.parametrize(
    ("step", "doubtful"), [(3, False), (len(RISE + HOLD) - 2, True)], ids=["before", "in the hold"]
)
def test_unconverged_hold_is_doubtful(tmp_path: Path, step: int, doubtful: bool) -> None:
    """The hold is what is judged: an unconverged step before it is counted, and casts no doubt."""
    changes = {step: {"converged": False}}
    with pytest.raises(GoalMissed, match="is held, but that is doubtful: 1 of 20") if doubtful else nullcontext():
        follow(tmp_path, RISE + HOLD, cube_heights(), changes=changes)
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert (metrics["held"], metrics["unconverged_steps"]) == (True, 1)
    assert metrics["unconverged_hold_steps"] == int(doubtful)
    assert metrics["goal_is_doubtful"] is doubtful


def test_mostly_unconverged_run_is_doubtful(tmp_path: Path) -> None:
    changes = {step: {"converged": False} for step in range(4)}
    with pytest.raises(GoalMissed, match=r"^'cube' is held, but that is doubtful: 4 of 25 steps did not converge$"):
        follow(tmp_path, RISE + HOLD, cube_heights(), changes=changes)


PUSH = {"body": "cube", "force": [1.0, 0.0, 0.0], "start": 5 * STEP, "duration": STEP}


@pytest.mark.parametrize(
    ("goal", "heights", "problem"),
    [
        ({"kind": "lifted", "height": 27.0}, [0.0, 28.0] + [0.0] * 24, None),
        ({"kind": "lifted", "height": 29.0}, [0.0, 28.0] + [0.0] * 24, "lifted by 28.00 mm at most (29 mm are needed)"),
        ({"kind": "placed", "position": [5.0, 6.0, 7.0]}, [0.0, 28.0] + [0.5] * 24, None),
        ({"kind": "placed", "position": [5.0, 6.0, 7.0]}, [0.0, 28.0] + [1.5] * 24, "1.50 mm from its place"),
        ({"kind": "placed", "position": [5.0, 6.0, 7.0]}, [0.0] * 20 + [0.5] * 6, "creep 0.5 mm"),
        ({"kind": "pushed"}, [0.0] * 6 + [0.9] * 20, None),
        ({"kind": "pushed"}, [0.0] * 6 + [1.1] * 20, "pushed away by 1.10 mm (tolerance 1 mm)"),
    ],
)
def test_goals_of_every_kind_are_judged(
    tmp_path: Path, goal: dict[str, Any], heights: list[float], problem: str | None
) -> None:
    """The base stays where it is; the cube rises to these heights [mm] before the first and after each step."""
    made = model()
    changes = {"goal": {"object": "cube", "hold": 1.9} | goal, "external_forces": [PUSH]}
    made.scene = Scene.model_validate(made.scene.model_dump(exclude_none=True) | changes)
    output = MetricsOutput(tmp_path)
    output.begin(made, state(0.0, heights[0]))
    for step, height in enumerate(heights[1:]):
        output.record(state(0.0, height), report(step))
    if problem is None:
        output.end("completed")
    else:
        with pytest.raises(GoalMissed, match=re.escape(f"'cube' is not {goal['kind']}: {problem}")):
            output.end("completed")
    written = json.loads((tmp_path / "metrics.json").read_text())
    assert (written["goal"], written["goal_reached"], written["held"]) == (goal["kind"], problem is None, None)
    assert output.summary()[f"cube {goal['kind']}"] == ("yes" if problem is None else "no")


@pytest.mark.parametrize(
    ("pressed", "error", "problem"),
    [
        (14.9, 0.0, None),
        (14.2, 0.7, None),
        (14.2, 1.5, "lifted, but that is doubtful: pressed with up to 14.2 +- 1.5 kPa (max_pressure 15 kPa); a finer"),
        (15.3, 0.0, "not lifted: pressed with up to 15.3 kPa (max_pressure 15 kPa)"),
    ],
)
def test_object_pressed_too_hard_misses_its_goal(
    tmp_path: Path, pressed: float, error: float, problem: str | None
) -> None:
    """In a single step, whatever holds at the end; how hard other pairs press each other does not count.

    Where the mesh may be wrong by more than what is left, nobody knows, and that is no success.
    """
    made = model()
    goal = {"object": "cube", "kind": "lifted", "height": 27.0, "hold": 1.9, "max_pressure": 15.0}
    made.scene = Scene.model_validate(made.scene.model_dump(exclude_none=True) | {"goal": goal})
    output = MetricsOutput(tmp_path)
    output.begin(made, state(0.0, 0.0))
    for step, height in enumerate([28.0] + [0.0] * 24):
        now = {("finger1", "cube"): pressed if step == 7 else 3.0, ("finger1", "floor"): 99.0}
        off = {("finger1", "cube"): error if step == 7 else 0.0}
        output.record(state(0.0, height), report(step, peak_pressures=now, peak_pressure_errors=off))
    if problem is None:
        output.end("completed")
    else:
        with pytest.raises(GoalMissed, match=re.escape(problem)):
            output.end("completed")
    assert output.metrics["peak_contact_pressures_kPa"]["finger1|cube"] == pressed
    assert output.metrics["peak_contact_pressure_errors_kPa"]["finger1|cube"] == error
    assert output.summary()["highest contact pressure"] == "99 +- 0 kPa (finger1|floor)"


def test_finger_that_swings_at_the_end_is_named(tmp_path: Path) -> None:
    output = MetricsOutput(tmp_path)
    output.begin(model(goal=False), state(0.0, 0.0))
    for step in range(20):
        bends = {"finger1": np.radians(95.0 + 13.0 * (-1) ** step), "finger2": 1.0}
        output.record(state(0.0, 0.0), report(step, bending_angles=bends))
    output.end("completed")
    assert output.metrics["bending_swings_degrees"] == {"finger1": pytest.approx([82.0, 108.0])}
    assert output.summary()["finger1 still swings"] == "bent by 82 to 108 degrees in the last 0.5 s"


def test_summary_says_what_is_doubtful(tmp_path: Path) -> None:
    output = MetricsOutput(tmp_path)
    output.begin(model(), state(0.0, 0.0))
    heights = list(zip((RISE + HOLD)[1:], cube_heights()[1:], strict=True))
    for step, (base, cube) in enumerate(heights):
        output.record(state(base, cube), report(step, converged=step < len(heights) - 3))
    with pytest.raises(GoalMissed, match="doubtful"):
        output.end("completed")
    assert output.summary()["cube held"] == "yes, but doubtful: 3 of 20 steps of the hold did not converge"


@pytest.mark.parametrize(
    ("base", "cube", "changes", "why"),
    [
        (
            RISE + HOLD,
            cube_heights(slip=1.2),
            {},
            "lifted by 28.75 mm with a base that rose 30.00 mm, slipped by 1.25 mm (tolerance 1 mm)",
        ),
        (RISE + HOLD, cube_heights(slip=-1.2), {}, "lifted by 31.15 mm with a base that rose 30.00 mm"),
        (RISE + HOLD, cube_heights(creep=0.12), {}, "creep 0.12 mm in the last 2 s (limit 0.1 mm)"),
        (RISE + HOLD, cube_heights(), {9: {"max_penetration": 1.5}}, "surfaces overlapped by 0.5 mm (contact_distance"),
        (
            RISE + HOLD,
            cube_heights(),
            {step: {"normal_forces": {("cube", "floor"): 9.81}} for step in range(30)},
            "no soft body touched it in the last 2 s",
        ),
        ([0.0] * 30, [0.0] * 30, {}, "the base rose by 0.00 mm (more than 1 mm is needed)"),
        ([0.0] + [1.5] * 29, [0.0] + [0.6] * 29, {}, "it rose by 0.60 mm (more than 1 mm is needed)"),
        (
            RISE + HOLD,
            cube_heights(),
            {len(RISE + HOLD) - 2: {"normal_forces": {("finger1", "cube"): 30.0, ("cube", "floor"): 9.81}}},
            "obstacles still carry it at the end, with 9.81 mN",
        ),
        (RISE, [0.0, 0.0, 0.0, 10.0, 20.0], {}, "the run of 0.4 s is shorter than the 2 s of holding"),
    ],
    ids=[
        "slips",
        "thrown up",
        "creeps",
        "overlaps",
        "not touched",
        "base stays",
        "stays on the floor",
        "put down",
        "too short",
    ],
)
def test_missed_goal_says_what_failed(
    tmp_path: Path, base: list[float], cube: list[float], changes: dict[int, dict[str, Any]], why: str
) -> None:
    with pytest.raises(GoalMissed) as missed:
        follow(tmp_path, base, cube, changes=changes)
    assert str(missed.value).startswith("'cube' is not held: ")
    assert why in str(missed.value)
    assert json.loads((tmp_path / "metrics.json").read_text())["held"] is False


def test_only_what_failed_is_named(tmp_path: Path) -> None:
    with pytest.raises(GoalMissed, match=r"^'cube' is not held: creep 0\.12 mm in the last 2 s \(limit 0\.1 mm\)$"):
        follow(tmp_path, RISE + HOLD, cube_heights(creep=0.12))


def test_failed_run_is_not_held_and_raises_nothing(tmp_path: Path) -> None:
    outcome = "step 3: body 'cube' exploded"
    metrics = follow(tmp_path, RISE + HOLD, cube_heights(), outcome=outcome)
    assert (metrics["held"], metrics["outcome"]) == (False, outcome)


@pytest.mark.parametrize("outcome", ["stopped", "interrupted"])
@pytest.mark.parametrize(("base", "reached"), [(RISE + HOLD, True), (RISE, None)])
def test_run_ended_by_its_user_is_judged_if_it_held(
    tmp_path: Path, outcome: str, base: list[float], reached: bool | None
) -> None:
    """What it would have done later is unknown; nothing is raised, since the user knows that the run has ended."""
    output = watch(tmp_path, base, cube_heights()[: len(base)])
    output.end(outcome)
    metrics = output.metrics
    assert (metrics["goal"], metrics["goal_reached"], metrics["held"]) == ("held", reached, reached)
    ended = f"{outcome} at {metrics['simulated_time_s']:g} s"
    assert output.summary()["cube held"] == (f"yes, {ended}" if reached else f"not judged: {ended}")


@pytest.mark.parametrize(
    ("outcome", "reached"), [("stopped", None), ("step 0: body 'cube' exploded", False)], ids=["stopped", "failed"]
)
def test_run_without_a_step_leaves_its_outcome(tmp_path: Path, outcome: str, reached: bool | None) -> None:
    metrics = follow(tmp_path, [0.0], [0.0], outcome=outcome)
    judged = {"goal": "held", "goal_reached": reached, "goal_is_doubtful": False, "held": reached}
    assert metrics == {"outcome": outcome, "steps": 0, **judged}


def test_scene_without_a_goal_is_not_judged(tmp_path: Path) -> None:
    metrics = follow(tmp_path, [0.0] * 3, [0.0] * 3, goal=False)
    assert metrics["held"] is None
    assert metrics["steps"] == 2
    assert "object_lift_mm" not in metrics


def test_unwritable_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "metrics.json").mkdir()
    with pytest.raises(TaichisoftError, match=r"metrics\.json: cannot be written: Is a directory$"):
        follow(tmp_path, RISE + HOLD, cube_heights())


def test_restart_forgets_earlier_steps(tmp_path):
    first, second = MetricsOutput(tmp_path / "first"), MetricsOutput(tmp_path / "second")
    for output in (first, second):
        output.begin(model(goal=False), state(0.0, 0.0))
    first.record(state(5.0, 5.0), report(7, max_penetration=9.0))
    first.restart(state(0.0, 0.0))
    for output in (first, second):
        output.record(state(1.0, 1.0), report(0))
        output.end("completed")
    assert first.metrics == second.metrics


def test_newton_residuals_are_reported_if_known(tmp_path: Path) -> None:
    """One step with a residual above time.newton_tolerance, 1e-7 mm."""
    residuals = {step: {"linearisations": 3 + step, "newton_residual": 1e-9} for step in range(4)}
    residuals[2] |= {"newton_residual": 2e-5, "converged": False}
    metrics = follow(tmp_path, [0.0] * 5, [0.0] * 5, goal=False, changes=residuals)
    assert metrics["linearisations_max"] == 6
    assert metrics["worst_newton_residual_mm"] == 2e-5
    assert (metrics["unconverged_newton_steps"], metrics["unconverged_steps"]) == (1, 1)
    assert "linearisations_max" not in follow(tmp_path, [0.0] * 5, [0.0] * 5, goal=False)


def test_inverted_elements_are_counted(tmp_path: Path) -> None:
    """As many as there were at once, and those that have not come back."""
    changes = {step: {"inverted_elements": count} for step, count in enumerate([0, 12, 7, 2])}
    metrics = follow(tmp_path, [0.0] * 5, [0.0] * 5, goal=False, changes=changes)
    assert (metrics["inverted_elements_max"], metrics["inverted_elements_at_end"]) == (12, 2)


def test_largest_stretch_of_each_body_is_kept(tmp_path: Path) -> None:
    """Of all looks and of the last state: a tetrahedron pulled to 1.5 of its length, then let go to 1.25."""
    model = fake_run.fake_model()
    model.cables = SimpleNamespace(names=())
    output = MetricsOutput(tmp_path)
    rest = SimpleNamespace(position=fake_run.REST, rigid_position=np.zeros((1, 3)), base_translation=np.zeros(3))
    output.begin(model, rest)
    assert output._stretch == {"finger": (1.0, 1.0)}
    for stretch in (1.5, 1.25):
        output._last_state = SimpleNamespace(position=fake_run.REST * [stretch, 1.0, 1.0])
        output._look_at_stretches()
    figures = output.figures("completed")
    assert figures["largest_stretch"]["finger"] == figures["stretch_99_percent"]["finger"] == pytest.approx(1.5)
