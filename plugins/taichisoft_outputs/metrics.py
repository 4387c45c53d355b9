"""The output "metrics": figures of a run in metrics.json, and whether it reached the goal of its scene."""

import json
import math
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft import Scene
from taichisoft.base import atomic_file, warn_caller
from taichisoft.control import FIGURES, Figure, In, text_of
from taichisoft.errors import GoalMissed
from taichisoft.mechanics import Stretches, spread
from taichisoft.running import Output, TrainingRange
from taichisoft.scene import Goal
from taichisoft_outputs.run_figures import LiftFigures, Slipping, StepFigures

if TYPE_CHECKING:
    from taichisoft.contact import Model
    from taichisoft.control import Observation
    from taichisoft.mechanics import State
    from taichisoft.running import Session
    from taichisoft.step import StepReport

# What a run has achieved of its scene's goal: the figures of each kind of goal, and what it falls short of.

DOUBTFUL_SHARE = 0.05
"""Share of the steps of a run that did not converge from which on nothing of it can be trusted."""


def shortcomings(scene: Scene, goal: Goal, metrics: Mapping[str, Any], floor_force: float) -> list[str]:
    """What keeps the goal from being reached; each names the figure and its limit.

    Args:
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


FILE_NAME = "metrics.json"
STRETCH_EVERY = 20
"""Steps from one look at the stretches to the next."""
SWING, SWING_LOOKS, LEAST_SWING = 0.5, 10, 1.0
"""Length of the end of a run in which fingers may swing [s], looks at them in it, and the least swing [degrees]."""
ENDED_BY_USER = ("stopped", "interrupted")
"""Outcomes of runs that may have reached their goal, or would have, had they gone on."""


class MetricsOutput(Output):
    """Keeps a few figures up to date; writes and judges them at the end."""

    def __init__(self, folder: Path):
        self.folder = Path(folder)
        self.metrics: dict[str, Any] = {}
        self._verdict = ""

    def begin(self, model: "Model", state: "State") -> None:
        """Look up the object of the scene's goal."""
        self._scene = model.scene
        self._watched = [figure for figure in FIGURES if In.LARGEST in figure.recorded and figure.per.names(model)]
        self._soft = [
            (body.name, body.nodes, Stretches(body.rest_position, body.elements)) for body in model.soft_bodies
        ]
        self._training = TrainingRange(model.soft_bodies, model.frames)
        goal = self._scene.goal
        self._goal_pressure = goal.max_pressure if goal is not None else None
        self._object = list(self._scene.rigid_bodies).index(goal.object) if goal is not None else None
        self.restart(state)

    def restart(self, state: "State") -> None:
        """Forget all steps before: figures count from the last start."""
        self._figures = StepFigures(self._scene.contact.contact_distance, self._scene.time.newton_tolerance)
        self._swing_every = max(round(SWING / SWING_LOOKS / self._scene.time.step), 1)
        self._bends: deque[Mapping[str, float]] = deque(maxlen=SWING_LOOKS + 1)
        self._stretch = {name: (1.0, 1.0) for name, _, _ in self._soft}
        self._beyond_training = {name: 0.0 for name in self._training.names}
        self._beyond_validation = {name: (0.0, 0.0) for name in self._training.validated}
        self._largest: list[dict[str, float]] = [{} for _ in self._watched]
        self._peak_pressures: dict[str, tuple[float, float]] = {}
        self._last_state = state
        self._slipping = Slipping(len(self._scene.soft_bodies), state)
        self._lift: LiftFigures | None = None
        if self._scene.goal is not None:
            goal = self._scene.goal
            hold_steps, push = max(1, round(goal.hold / self._scene.time.step)), first_push(self._scene, goal)
            self._lift = LiftFigures(
                self._scene.up, hold_steps, push, state.base_translation, self._object_position(state)
            )

    def record(self, state: "State", report: "StepReport") -> None:
        """Include a step."""
        self._figures.add(report)
        self._last_state = state
        if self._lift is not None:
            forces = np.array([self._normal_force(report, [body]) for body in self._scene.soft_bodies])
            slide = self._slipping.add(state)[self._object]
            self._lift.add(state.base_translation, self._object_position(state), slide, forces, report.converged)
        if self._figures.steps % self._swing_every == 0:
            self._bends.append(report.observation.truth.bending_angles)
        for figure, largest in zip(self._watched, self._largest, strict=True):
            for name, value in figure.values(report.observation.truth).items():
                largest[text_of(name)] = max(largest.get(text_of(name), value), value, key=abs)
        if self._figures.steps % STRETCH_EVERY == 0:
            self._look_at_stretches()
        if self._figures.steps % STRETCH_EVERY == 0 or self._goal_pressure is not None:
            self._look_at_pressures(report)

    def end(self, outcome: str) -> None:
        """Write metrics.json."""
        self.metrics = self.figures(outcome)
        goal, completed = self._scene.goal, outcome == "completed"
        judged = goal is not None and self._figures.last is not None and (completed or outcome in ENDED_BY_USER)
        missed = self._shortcomings() if judged else []
        reached = None if goal is None else judged and not missed
        if outcome in ENDED_BY_USER and not reached:
            reached = None
        doubt = doubts(self.metrics, len(self._lift.forces)) if reached and self._lift is not None else ""
        if (
            reached
            and not doubt
            and self._goal_pressure is not None
            and sum(self._hardest_press()) > self._goal_pressure
        ):
            doubt = f"{self._pressed()} (max_pressure {self._goal_pressure:g} kPa); a finer mesh would tell"
        self.metrics |= {
            "goal": None if goal is None else goal.kind,
            "goal_reached": reached,
            "goal_is_doubtful": bool(doubt),
            "held": reached if goal is not None and goal.kind == "held" else None,
        }
        self._verdict = self._words(reached, doubt, outcome)
        self._write()
        if goal is not None and completed and missed:
            raise GoalMissed(f"'{goal.object}' is not {goal.kind}: {'; '.join(missed)}")
        if goal is not None and completed and doubt:
            raise GoalMissed(f"'{goal.object}' is {goal.kind}, but that is doubtful: {doubt}")

    def figures(self, outcome: str) -> dict[str, Any]:
        """The figures of the steps so far, by name, without whether the goal was reached."""
        self._look_at_stretches()
        figures = {"outcome": outcome, **self._figures.metrics(self._scene.time.step), **self._body_metrics()}
        if self._stretch:
            figures["largest_stretch"] = {name: largest for name, (largest, _) in self._stretch.items()}
            figures["stretch_99_percent"] = {name: most for name, (_, most) in self._stretch.items()}
        figures |= self._training_metrics()
        if self._figures.last is not None:
            named = zip(self._watched, self._largest, strict=True)
            figures |= {figure.metric("largest"): largest for figure, largest in named}
            figures |= {"bending_swings_degrees": swings} if (swings := self._swings()) else {}
            if self._lift is not None and self._scene.goal is not None:
                figures |= self._lift.metrics(self._scene.goal.position, list(self._scene.soft_bodies))
        return figures

    def summary(self) -> dict[str, str]:
        """Rows of the table that closes a run."""
        m = self.metrics
        if not m or not self._figures.steps:
            return {}
        inverted, at_end = m["inverted_elements_max"], m["inverted_elements_at_end"]
        rows, newton = {}, {}
        if "linearisations_max" in m:
            newton = {
                "linearisations, most": str(m["linearisations_max"]),
                "linearisations not enough": f"in {m['unconverged_newton_steps']} steps",
                "motion that another one would make, worst": f"{m['worst_newton_residual_mm']:.2g} mm",
            }
        if self._scene.goal is not None:
            rows = {
                f"{self._scene.goal.object} {self._scene.goal.kind}": self._verdict,
                f"{self._scene.goal.object} lifted by": f"{m['object_lift_mm']:z.2f} of {m['base_lift_mm']:z.2f} mm",
                "slip": f"{m['object_slip_mm']:z.3f} mm",
                "creep while held": f"{m['object_creep_mm']:.4f} mm in {self._scene.goal.hold:g} s",
                "normal force of the fingers, peak": f"{m['peak_normal_force_mN']:.1f} mN",
                "normal force of the fingers, mean while held": _sum_of(m),
            }
        for name, (low, high) in m.get("bending_swings_degrees", {}).items():
            rows[f"{name} still swings"] = f"bent by {low:.0f} to {high:.0f} degrees in the last {SWING:g} s"
        for figure in self._watched:
            actuator, value = max(m[figure.metric("largest")].items(), key=lambda item: abs(item[1]))
            rows[f"largest {figure.name}"] = f"{value:z.{figure.digits + 1}f} {figure.unit} ({actuator})"
        if self._peak_pressures:
            pair = max(self._peak_pressures, key=lambda pair: self._peak_pressures[pair])
            peak, error = self._peak_pressures[pair]
            rows["highest contact pressure"] = f"{peak:.3g} +- {error:.2g} kPa ({pair})"
        if self._stretch:
            name = max(self._stretch, key=lambda body: self._stretch[body])
            largest, most = self._stretch[name]
            rows["largest stretch, and of 99 % of the elements"] = f"{largest:.2f} and {most:.2f} ({name})"
        return rows | {
            "largest penetration of the contact distance": f"{m['max_penetration_mm']:.3g} mm",
            "steps with surfaces that overlap": f"{m['overlapping_steps']} of {m['steps']}",
            "solver iterations, median and most": f"{m['iterations_median']:.0f} and {m['iterations_max']}",
            "steps not converged": f"{m['unconverged_steps']} of {m['steps']}",
            **newton,
            **({"elements turned inside out, most and at the end": f"{inverted} and {at_end}"} if inverted else {}),
            "time per step, median": f"{m['step_time_median_ms']:.1f} ms",
            "real-time factor": f"{m['real_time_factor']:.2f}",
        }

    def _words(self, reached: bool | None, doubt: str, outcome: str) -> str:
        if outcome not in ENDED_BY_USER:
            return "no" if not reached else f"yes, but doubtful: {doubt}" if doubt else "yes"
        ended = f"{outcome} at {self.metrics.get('simulated_time_s', 0.0):g} s"
        return f"not judged: {ended}" if not reached else f"yes, {ended}{f', but doubtful: {doubt}' if doubt else ''}"

    def _write(self) -> None:
        path = self.folder / FILE_NAME
        with atomic_file(path) as partial:
            self.folder.mkdir(parents=True, exist_ok=True)
            partial.write_text(json.dumps(self.metrics, indent=2) + "\n", encoding="utf-8")

    def _object_position(self, state: "State") -> np.ndarray:
        return state.rigid_position[self._object]

    def _body_metrics(self) -> dict[str, Any]:
        """Volumes of the soft bodies at rest, and where everything is and what presses after the last step."""
        volumes = {name: float(stretches.rest_volumes.sum()) for name, _, stretches in self._soft}
        figures: dict[str, Any] = {"rest_volumes_mm3": volumes} if volumes else {}
        if self._figures.last is None:
            return figures
        seen = self._figures.last.observation.truth
        return figures | {
            **{figure.metric("final"): _last(figure, seen) for figure in FIGURES if In.FINAL in figure.recorded},
            "peak_contact_pressures_kPa": {name: peak for name, (peak, _) in self._peak_pressures.items()},
            "peak_contact_pressure_errors_kPa": {name: off for name, (_, off) in self._peak_pressures.items()},
        }

    def _look_at_stretches(self) -> None:
        """Keep the largest stretches of each body, and the stretches that 99 % of its elements stay below."""
        for name, nodes, stretches in self._soft:
            largest, most = spread(stretches.largest(self._last_state.position[nodes]))
            before = self._stretch[name]
            self._stretch[name] = max(largest, before[0]), max(most, before[1])
        for name, share in self._training.beyond(self._last_state).items():
            self._beyond_training[name] = max(self._beyond_training[name], share)
        if self._beyond_validation and self._figures.last is not None:
            for name, doubt in self._training.beyond_validation(self._figures.last.imbalance).items():
                self._beyond_validation[name] = max(self._beyond_validation[name], doubt)

    def _look_at_pressures(self, report: "StepReport") -> None:
        """Keep the highest contact pressures: of every step where the goal asks for it, else of some."""
        seen = report.observation.truth
        for pair, pressure in seen.peak_pressures.items():
            name, before = "|".join(pair), self._peak_pressures.get("|".join(pair), (0.0, 0.0))
            self._peak_pressures[name] = max(before, (pressure, seen.peak_pressure_errors.get(pair, 0.0)))

    def _swings(self) -> dict[str, list[float]]:
        """Least and greatest bending angle [degrees] at the end, of the fingers that still swing then."""
        fingers = self._bends[-1] if self._bends else ()
        ends = {name: np.degrees([bends[name] for bends in self._bends]) for name in fingers}
        return {name: [of.min(), of.max()] for name, of in ends.items() if np.ptp(of) >= LEAST_SWING}

    def _training_metrics(self) -> dict[str, Any]:
        """How far each reduced body went beyond training and validation; nothing where there is none."""
        figures: dict[str, Any] = {"beyond_training": self._beyond_training} if self._beyond_training else {}
        if self._beyond_validation:
            doubts = self._beyond_validation.items()
            figures["imbalance_over_validation"] = {name: times for name, (times, _) in doubts}
            figures["estimated_error_mm"] = {name: error for name, (_, error) in doubts}
        return figures

    def _normal_force(self, report: "StepReport", others: Iterable[str]) -> float:
        """Sum of the normal forces between the object and other bodies [mN]."""
        assert self._scene.goal is not None
        pairs = [{self._scene.goal.object, other} for other in others]
        return sum(force for pair, force in report.observation.truth.normal_forces.items() if set(pair) in pairs)

    def _shortcomings(self) -> list[str]:
        assert self._scene.goal is not None and self._figures.last is not None
        floor_force = self._normal_force(self._figures.last, self._scene.obstacles)
        missed = shortcomings(self._scene, self._scene.goal, self.metrics, floor_force)
        highest, _ = self._hardest_press()
        if self._goal_pressure is not None and highest > self._goal_pressure:
            missed.append(f"{self._pressed()} (max_pressure {self._goal_pressure:g} kPa)")
        return missed

    def _hardest_press(self) -> tuple[float, float]:
        """Highest pressure on the goal's object, and how far the mesh may be wrong about it [kPa]."""
        assert self._scene.goal is not None
        pressed = self._peak_pressures.items()
        return max((one for name, one in pressed if self._scene.goal.object in name.split("|")), default=(0.0, 0.0))

    def _pressed(self) -> str:
        highest, error = self._hardest_press()
        return (
            f"pressed with up to {highest:.3g} +- {error:.2g} kPa" if error else f"pressed with up to {highest:.3g} kPa"
        )


def _sum_of(metrics: Mapping[str, Any]) -> str:
    parts = ", ".join(f"{name} {force:.1f}" for name, force in metrics["mean_normal_forces_mN"].items())
    return f"{metrics['mean_normal_force_mN']:.1f} mN ({parts})"


def _last(figure: Figure, seen: "Observation") -> dict[str, Any]:
    values = figure.values(seen)
    return {text_of(name): np.asarray(figure.value(values, name)).tolist() for name in values}


def warn_of_late_motion(session: "Session") -> None:
    """Warn where the base is known to move while the object of the goal must stand still, at the end of the run."""
    scene, start = session.simulation.model.scene, session.first_state.time
    goal, end = scene.goal, start + session.step_count * scene.time.step
    is_judged = any(isinstance(output, MetricsOutput) for output in session.outputs)
    if goal is None or goal.kind == "lifted" or not is_judged or session.replaying or not math.isfinite(end):
        return
    stop = session.controller.base_stops_at(session.simulation.observe())
    if stop is None or stop <= start or end - stop > goal.hold - 0.5 * scene.time.step:
        return
    warn_caller(
        f"the controller moves the base until {stop:g} s, and the run ends at {end:g} s: '{goal.object}' counts as "
        f"{goal.kind} only if it stands still for the last {goal.hold:g} s (goal.hold), so a duration of "
        f"{stop + goal.hold - start:g} s or more is needed"
    )
