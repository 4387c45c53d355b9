"""What a run has achieved of its scene's goal: the figures of each kind of goal, and what it falls short of."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from taichisoft import Scene
from taichisoft.scenes import Goal
from taichisoft_outputs.run_figures import LiftFigures

DOUBTFUL_SHARE = 0.05
"""Share of the steps of a run that did not converge from which on nothing of it can be trusted."""


def goal_figures(scene: Scene, goal: Goal, lift: LiftFigures) -> dict[str, Any]:
    """Figures of the goal's object; lift and slip are counted from the moment before the base moves."""
    base_lift, object_lift = float(lift.base_way @ scene.up), float(lift.object_way @ scene.up)
    position = lift.positions[-1]
    figures = {
        "object_lift_mm": object_lift,
        "object_peak_lift_mm": lift.peak_lift,
        "base_lift_mm": base_lift,
        "object_slip_mm": lift.slip,
        "object_creep_mm": lift.creep,
        "final_object_position_mm": position.tolist(),
    }
    if goal.position is not None:
        figures["object_distance_mm"] = float(np.linalg.norm(position - goal.position))
    if lift.pushed_away is not None:
        figures["object_pushed_away_mm"] = lift.pushed_away
    return figures


def shortcomings(scene: Scene, goal: Goal, metrics: Mapping[str, Any], floor_force: float) -> list[str]:
    """What keeps the goal from being reached; each names the figure and its limit.

    Args:
        scene: scene of the run.
        goal: its goal.
        metrics: figures of the run.
        floor_force: sum of the forces between object and obstacles at the end [mN].
    """
    gap = scene.contact.contact_distance
    kinds = {"held": _held, "placed": _placed, "pushed": _pushed, "lifted": _lifted}
    checks = [
        *kinds[goal.kind](goal, metrics, floor_force),
        (
            metrics["max_penetration_mm"] <= gap,
            f"surfaces overlapped by {metrics['max_penetration_mm'] - gap:.2g} mm (contact_distance {gap:g} mm)",
        ),
    ]
    if goal.kind != "lifted":
        checks.append(
            (
                metrics["simulated_time_s"] > goal.hold - 0.5 * scene.time.step,
                f"the run of {metrics['simulated_time_s']:g} s is shorter than the {goal.hold:g} s of holding",
            )
        )
    return [text for reached, text in checks if not reached]


def doubts(metrics: Mapping[str, Any], hold_steps: int) -> str:
    """Why a goal that is reached cannot be trusted; empty when it can."""
    held, whole = metrics["unconverged_hold_steps"], metrics["unconverged_steps"]
    if held:
        return f"{held} of {hold_steps} steps of the hold did not converge"
    if whole > DOUBTFUL_SHARE * metrics["steps"]:
        return f"{whole} of {metrics['steps']} steps did not converge"
    return ""


Check = tuple[bool, str]


def _held(goal: Goal, m: Mapping[str, Any], floor_force: float) -> Iterator[Check]:
    yield (
        abs(m["object_slip_mm"]) <= goal.tolerance,
        f"lifted by {m['object_lift_mm']:z.2f} mm with a base that rose {m['base_lift_mm']:z.2f} mm, slipped by "
        f"{m['object_slip_mm']:z.2f} mm "
        f"(tolerance {goal.tolerance:g} mm)",
    )
    # An object that stays where it is slips by less than the tolerance, too, while the base rises by less.
    yield (
        m["base_lift_mm"] > goal.tolerance,
        f"the base rose by {m['base_lift_mm']:z.2f} mm (more than {goal.tolerance:g} mm is needed)",
    )
    yield (
        m["object_lift_mm"] > goal.tolerance,
        f"it rose by {m['object_lift_mm']:z.2f} mm (more than {goal.tolerance:g} mm is needed)",
    )
    yield from _carried(goal, m, floor_force)
    yield _still(goal, m)


def _placed(goal: Goal, m: Mapping[str, Any], _floor_force: float) -> Iterator[Check]:
    distance = m["object_distance_mm"]
    yield (
        distance <= goal.tolerance,
        f"{distance:.2f} mm from its place (tolerance {goal.tolerance:g} mm)",
    )
    yield _still(goal, m)


def _pushed(goal: Goal, m: Mapping[str, Any], floor_force: float) -> Iterator[Check]:
    way = m.get("object_pushed_away_mm")
    yield way is not None, "no external force acts on it in this run"
    if way is not None:
        yield way <= goal.tolerance, f"pushed away by {way:.2f} mm (tolerance {goal.tolerance:g} mm)"
    yield from _carried(goal, m, floor_force)
    yield _still(goal, m)


def _lifted(goal: Goal, m: Mapping[str, Any], _floor_force: float) -> Iterator[Check]:
    assert goal.height is not None
    peak = m["object_peak_lift_mm"]
    yield peak >= goal.height, f"lifted by {peak:z.2f} mm at most ({goal.height:g} mm are needed)"


def _carried(goal: Goal, m: Mapping[str, Any], floor_force: float) -> Iterator[Check]:
    yield floor_force == 0.0, f"obstacles still carry it at the end, with {floor_force:.3g} mN"
    yield m["mean_normal_force_mN"] > 0.0, f"no soft body touched it in the last {goal.hold:g} s"


def _still(goal: Goal, m: Mapping[str, Any]) -> Check:
    creep = m["object_creep_mm"]
    return creep <= goal.creep, f"creep {creep:.3g} mm in the last {goal.hold:g} s (limit {goal.creep:g} mm)"


def first_push(scene: Scene, goal: Goal) -> int | None:
    """Number of steps made before the first external force on the object acts; None without one."""
    starts = [force.start for force in scene.external_forces if force.body == goal.object]
    return round(min(starts) / scene.time.step) if starts else None
