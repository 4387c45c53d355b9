"""Equilibria: where bodies rest under their loads, and the requests under which they rest at targets."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np

from taichisoft.base.text import warn_caller
from taichisoft.contact.model import Model
from taichisoft.control.control import Control
from taichisoft.control.observation import Observation, ObservedFigure, find_figure
from taichisoft.errors import ControlError, EquilibriumNotFound, TaichisoftError
from taichisoft.mechanics.state import State
from taichisoft.running.simulation import Simulation, check_simulation
from taichisoft.step.linearisation import LOADS, Linearisation, acting_forces, asked_for, asking, linearise
from taichisoft.step.time_stepper import TimeStepper


@dataclass(frozen=True)
class Equilibrium:
    """Bodies at rest.

    Attributes:
        state: the state, with the time of the state from which the search began and no velocities, for
            `Simulation.restore`.
        observation: what a controller sees in it; sensors have long seen it.
        linearisations: number of linearisations of the soft bodies' equations, over all increments.
        increments: number of parts in which the loads were changed: 1 unless the equations had no solution in reach.
        residual: largest move of a node by another linearisation, or by another search for contacts [mm].
        stiffness: least stiffness of all small moves, over that without the loads' share [-]: near 1 where loads hardly
            matter, 0 where the equilibrium becomes unstable, negative beyond; to a tenth of itself. Contacts act as
            they do: those that press stay closed, those that stick do not slide, those at the limit of friction do
            against the friction they have, and open ones stay open; pressures and tensions turn with the bodies, sealed
            air and imposed volumes or pulls resist. Left out is how contacts turn with rigid bodies, see `unchecked`.
            None without soft bodies.
        left: `stiffness` of the unstable equilibrium from which the bodies have gone on to this one; else None.
        warning: what is to be said of its stability, or nothing.
        unchecked: free rigid bodies that something presses. Whether they stay is not checked: a box balanced on an edge
            and a stack about to topple rest as one that lies flat does; a motion from a small tilt tells.
    """

    state: State
    observation: Observation
    linearisations: int
    increments: int
    residual: float
    stiffness: float | None
    left: float | None
    warning: str
    unchecked: tuple[str, ...]
    _stepper: TimeStepper = field(repr=False, compare=False)

    @cached_property
    def stretch_over_law(self) -> Mapping[str, float]:
        """By soft body, largest stretch of an element over that up to which its law holds, see `StepReport` [-]."""
        return self._stepper.strain_watch.over_law(self.state)

    def linearise(self, controls: Sequence[str] | None = None) -> Linearisation:
        """Derivatives of what is observed in the equilibrium by the requests: its compliance.

        As `Simulation.linearise`, of the equilibrium from here. A contact at the limit of its friction slides on in
        the direction in which friction opposes it, which is where increasing loads have driven it; where they decrease
        it would stick. Contacts do not turn with bodies, which is exact on flat obstacles, and some percent between
        pads and a rigid body; nor do forces from outside on rigid bodies.

        Args:
            controls: names of the controls by which to derive, see `Linearisation`; None: by all that can be varied.

        Raises:
            ControlError: a name in `controls` is not that of something which can be varied.
            SceneError: a contact has restitution, spinning or rolling friction.
        """
        self._stepper.restore(self.state)
        return linearise(self._stepper, None, controls)


def equilibrium(simulation: Simulation, control: Control | None = None, stable: bool = True) -> Equilibrium:
    """Find where the bodies of a simulation come to rest; the simulation stays unchanged.

    The search begins with the present state: where there are several equilibria it finds one near by, and friction
    keeps what sticks. It solves the static equations with contacts and actuators by Newton's method with a line search,
    to `time.newton_tolerance` [mm]. Where that fails it changes the loads in smaller increments, and where bodies may
    touch in so small ones that no node moves by more than half of `contact.alarm_distance` at once. Limits of
    pressures and so on hold, limits of their rates do not. A body beyond the range of its law is warned of, once.

    Rigid bodies go along in moves of one time step from rest, in which their inertia alone keeps them back and friction
    holds what sticks, until none moves by more than 1e-6 mm (a proximal point method: Rockafellar 1976, Monotone
    operators and the proximal point algorithm). The heavier they are, the more moves.

    An equilibrium that a small move makes the bodies leave, such as that of a column straight under more than its
    critical load, is left on the side from which they came, for a stable one; a warning says so. What stability is
    checked against says `Equilibrium.stiffness`.

    Args:
        simulation: a simulation whose soft bodies all have anchors.
        control: pressures, pulls, base and so on, as for a step; None: the last ones.
        stable: False: stay in an unstable equilibrium that the search finds.

    Raises:
        ControlError: `control` requests something impossible.
        SceneError: a soft body has no anchors.
        EquilibriumNotFound: the loads cannot be carried, such as a pressure beyond which a cavity grows on and on,
            nothing holds a rigid body, or only an unstable equilibrium is near.
    """
    control = Control() if control is None else control
    statics = statics_of(simulation)
    simulation.warn_of_units(control)
    rest = statics.find(simulation.state, control, stable)
    if rest.warning and stable:
        warn_caller(rest.warning)
    simulation.warn_beyond_law(rest.state)
    return rest


def statics_of(simulation: Simulation) -> "Statics":
    """The static variant of a simulation's model, which it keeps."""
    check_simulation(simulation)
    statics: Statics = simulation.keep("statics", lambda: Statics(simulation.model))
    if statics.source is not simulation.model:  # changed since
        statics.set_model(simulation.model)
    return statics


class Statics:
    """A static variant of a model, with its work space.

    Attributes:
        source: the model of which it is a variant.
        model: the variant.
        requests: what takes over requests into its states.
    """

    def __init__(self, model: Model):
        """Make the variant, see `Model.static`."""
        self.set_model(model)

    def set_model(self, model: Model) -> None:
        """Become a variant of another model."""
        self.source = model
        self._stepper = TimeStepper(model.static())
        self.model, self.requests = self._stepper.model, self._stepper.requests

    def close(self) -> None:
        """Nothing is left open."""

    def find(self, start: State, control: Control, stable: bool = True) -> Equilibrium:
        """The equilibrium under a control, from a state on."""
        stepper = self._stepper
        requested = stepper.requests.apply(start, control)
        rest = stepper.find_equilibrium(start, requested, stable)
        no_velocity = np.zeros_like(start.frame_velocity)
        memory = rest.state.sensor_memory.copy()
        memory[1:2] = 0.0  # sensors have long seen what rests: their samples begin anew
        changes = {"time": start.time, "step": start.step, "frame_velocity": no_velocity, "sensor_memory": memory}
        # No step has passed of a force that acts for some.
        steps = requested.external_force_steps + (requested.external_force_steps > 0)
        state = rest.state.changed(**changes, external_force_steps=steps)
        stepper.restore(state)
        state = stepper.state
        return Equilibrium(
            state=state,
            observation=stepper.observe(),
            linearisations=rest.report.linearisations,
            increments=rest.increments,
            residual=rest.residual,
            stiffness=rest.stiffness,
            left=rest.left,
            warning=rest.warning,
            unchecked=rest.unchecked,
            _stepper=stepper,
        )


# Inverse statics: pressures, pulls and poses of the base under which soft bodies rest at targets.

SCALES = {"bending_angles": 0.01, "normal_forces": 10.0, "friction_forces": 10.0, "base_force": 10.0}
"""Differences of targets that count as much as one of 1 mm, in the units of the figures; of all others 1."""
REACHED = 1e-3
"""Residual over its scale below which a target counts as reached [-]."""
FOUND = 1e-5
"""Residual over its scale at which the search ends [-]."""
NEAR = 3e-4
"""The same where friction acts, and every equilibrium is found from the start [-]."""
MOST_TRIALS = 60
STARTS = (0.5, 0.25, 0.75, 0.05, 0.95)
"""Places in the ranges where the search may begin, if nothing depends on anything where it is now."""
INSIDE = 0.02
"""Least distance from the ends of the ranges at the beginning, over the ranges [-]."""
NO_FRICTION = 1e-6
"""Friction below which the path to an equilibrium does not matter [mN]."""
SLOW, LONGEST = 0.01, 20.0
"""Speed of all nodes and rigid bodies below which a motion counts as ended [mm/s], and the longest motion [s]."""


@dataclass(frozen=True)
class InverseSolution:
    """The requests that reach targets at rest, or come nearest to them.

    Attributes:
        control: asks for it.
        values: of the controls that `bounds` names, in kPa, mN, mm and so on.
        equilibrium: the equilibrium under it; `equilibrium.linearise()` has the derivatives there.
        residuals: what is observed less the target, in the figure's unit, NaN where a target leaves it free.
        reached: whether all residuals are below a thousandth of their scales: 1e-3 mm, 1e-5 rad, 0.01 mN.
        at_bounds: controls that are at an end of their range.
        trials: number of equilibria that were looked for.
        message: in words: reached, or how far each target is off, and which bounds stand in the way.
    """

    control: Control
    values: Mapping[str, float]
    equilibrium: Equilibrium
    residuals: Mapping[str, np.ndarray]
    reached: bool
    at_bounds: tuple[str, ...]
    trials: int
    message: str


def inverse(
    simulation: Simulation,
    targets: Mapping[str, Any],
    bounds: Mapping[str, tuple[float, float]],
    scales: Mapping[str, float] | None = None,
    by: Literal["statics", "motion"] = "statics",
) -> InverseSolution:
    """Find the requests under which soft bodies rest at targets; the simulation stays unchanged.

    Nonlinear least squares over equilibria, with the derivatives of `Equilibrium.linearise`, by scipy's dogleg in
    rectangular trust regions (Voglis and Lagaris 2004, A rectangular trust region dogleg approach for unconstrained and
    bound constrained nonlinear optimization). Targets out of reach give the nearest that the bounds allow, each
    residual over its scale. The search begins with the present requests; it is local, and finds one solution of
    several, from one equilibrium to the next. Where friction acts, which depends on the path, a second search finds
    all equilibria from the present state: by statics along a straight path, or `by` motion, with steps under the
    control until nothing moves any more, as `Simulation.step` makes them with the solution.

    Args:
        simulation: a simulation with soft bodies, all of them with anchors.
        targets: values of figures by the names of `rollouts`, such as {"tip_positions.finger": [0.0, 12.0, -90.0],
            "bending_angles.finger": 0.6, "normal_forces.finger|wall": 150.0}; NaN leaves an entry free.
        bounds: lowest and highest value of every control that may change, by the names of `Linearisation`, such as
            {"pressure.finger.cavity": (0.0, 40.0), "base_translation.z": (-5.0, 5.0)}.
        scales: differences of targets that count equally, by the names of the targets; where none is given 1 mm,
            0.01 rad and 10 mN, of other figures 1.
        by: "statics" or "motion"; without friction both have the same ends.

    Raises:
        TaichisoftError: a target, a bound or a scale is not valid, or nothing can be varied.
        ControlError: a control cannot be requested.
        SceneError: see `equilibrium`.
        EquilibriumNotFound: there is no equilibrium where the search begins.
    """
    if by not in ("statics", "motion"):
        raise TaichisoftError(f"by = {by!r}: must be 'statics' or 'motion'")
    search = _Search(simulation, targets, bounds, scales or {})
    search.run(search.start())
    if search.has_friction:
        search.run(search.begin_anew(by))
    solution = search.solution()
    simulation.warn_of_units(solution.control)
    simulation.warn_beyond_law(solution.equilibrium.state)
    return solution


class _Found(Exception):
    """The targets are reached: further steps would change nothing."""


class _Search:
    """The residuals of targets as a function of the requests, and their derivatives."""

    def __init__(
        self, simulation: Simulation, targets: Mapping[str, Any], bounds: Mapping[str, Any], scales: Mapping[str, Any]
    ):
        self._statics: Statics = statics_of(simulation)
        self._state = simulation.state
        self.names, self.bounds = tuple(bounds), _checked_bounds(bounds)
        observation = simulation.observe()
        self._figures: list[tuple[ObservedFigure, np.ndarray, float]] = []
        if not isinstance(targets, Mapping) or not targets:
            raise TaichisoftError("targets: must be a dictionary with a figure or more")
        for name, target in targets.items():
            figure = find_figure(name, observation, simulation.model.body_names)
            scale = scales.get(name, SCALES.get(figure.field, 1.0))
            if not isinstance(scale, int | float) or not 0.0 < scale < np.inf:
                raise TaichisoftError(f"scales['{name}'] = {scale!r}: must be above 0")
            self._figures.append((figure, _checked_target(name, target, figure.of(observation)), float(scale)))
        for name in scales:
            if name not in targets:
                raise TaichisoftError(f"scales: '{name}' is not a target; targets are {', '.join(targets)}")
        self._model = simulation.model
        self._from_start: str | None = None
        self._known: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
        self._last: tuple[bytes, Equilibrium] | None = None
        self._best: tuple[float, np.ndarray, Equilibrium] | None = None
        self._trials = 0

    def run(self, start: np.ndarray) -> None:
        """Search for the best values from these on."""
        from scipy.optimize import least_squares  # takes 0.2 s to import

        with suppress(_Found):
            least_squares(
                self.residuals,
                start,
                self.jacobian,
                method="dogbox",
                bounds=self.bounds.T,
                x_scale=np.diff(self.bounds)[:, 0],
                ftol=1e-13,
                xtol=1e-11,
                gtol=1e-13,
                max_nfev=MOST_TRIALS,
            )

    @property
    def has_friction(self) -> bool:
        """Whether friction acts in the best equilibrium so far."""
        assert self._best is not None
        return sum(self._best[2].observation.truth.friction_forces.values()) >= NO_FRICTION

    def begin_anew(self, by: str) -> np.ndarray:
        """Find all further equilibria from the start, by statics or motion; returns the best values so far."""
        assert self._best is not None
        values = self._best[1]
        self._from_start, self._last, self._best, self._known = by, None, None, None
        return values

    def start(self) -> np.ndarray:
        """Where to begin: at the present requests, or where every target depends on something."""
        low, high = self.bounds.T
        margin = INSIDE * (high - low)
        now = np.array([asked_for(self._statics.requests, self._state, name) for name in self.names])
        inside = np.clip(now, low + margin, high - margin)
        places: list[np.ndarray] = [inside, np.clip(now, low, high), *(low + share * (high - low) for share in STARTS)]
        first: np.ndarray | None = None
        problem: EquilibriumNotFound | None = None
        for place in places:
            try:
                residuals, rows = self.residuals(place), self.jacobian(place)
            except EquilibriumNotFound as error:
                problem = error
                continue
            except _Found:
                return place
            first = place if first is None else first
            if (rows != 0.0).any(axis=1)[np.abs(residuals) > REACHED].all():
                return place
        if first is None:
            assert problem is not None
            raise problem
        return first

    def residuals(self, values: np.ndarray) -> np.ndarray:
        """Of all targets over their scales; NaN where there is no equilibrium, so that the next step is shorter."""
        try:
            rest = self._equilibrium(values)
        except EquilibriumNotFound:
            if self._best is None:
                raise
            return np.full(sum(int(np.isfinite(target).sum()) for _, target, _ in self._figures), np.nan)
        residuals = self._all_residuals(rest)
        size = float(residuals @ residuals)
        if self._best is None or size < self._best[0]:
            self._best = size, values.copy(), rest
        if np.abs(residuals).max(initial=0.0) < (FOUND if self._from_start is None else NEAR):
            raise _Found
        return residuals

    def jacobian(self, values: np.ndarray) -> np.ndarray:
        """Derivatives of the residuals, shape (residual_count, control_count).

        Those of an equilibrium leave out how the path there changes. Where it counts they are corrected by what changed
        from one trial to the next (Broyden 1965, A class of methods for solving nonlinear simultaneous equations).
        """
        here = self._equilibrium(values)
        if self._from_start is not None and self._known is not None:
            before, residuals, rows = self._known
            shift = (values - before) / np.diff(self.bounds)[:, 0]
            change = self._all_residuals(here) - residuals
            if shift.any():
                rows = rows + np.outer(change - rows @ shift, shift) / (shift @ shift)
        else:
            linear = here.linearise(self.names)
            parts = [linear[figure.name][np.isfinite(target)] / scale for figure, target, scale in self._figures]
            rows = np.vstack(parts) * np.diff(self.bounds)[:, 0]
        self._known = values.copy(), self._all_residuals(here), rows
        return np.asarray(rows / np.diff(self.bounds)[:, 0])

    def solution(self) -> InverseSolution:
        """The best that was found."""
        assert self._best is not None
        _, values, rest = self._best
        residuals = {figure.name: figure.of(rest.observation) - target for figure, target, _ in self._figures}
        off = {
            figure.name: float(np.nanmax(np.abs(residuals[figure.name]), initial=0.0)) / scale
            for figure, _, scale in self._figures
        }
        near = 1e-6 * np.diff(self.bounds)[:, 0]
        at_end = (np.abs(values[:, None] - self.bounds) <= near[:, None]).any(axis=1)
        at_bounds = tuple(name for name, is_there in zip(self.names, at_end, strict=True) if is_there)
        missed = [name for name, size in off.items() if not size < REACHED]
        return InverseSolution(
            control=self._control(values),
            values=dict(zip(self.names, values.tolist(), strict=True)),
            equilibrium=rest,
            residuals=residuals,
            reached=not missed,
            at_bounds=at_bounds,
            trials=self._trials,
            message=_in_words(missed, residuals, at_bounds) + self._caution(rest),
        )

    def _caution(self, rest: Equilibrium) -> str:
        caution = f"; {rest.warning}" if rest.warning else ""
        if self._from_start == "statics":
            caution += (
                "; friction depends on the way, and this is at rest on a straight one: inverse(..., by='motion') finds "
                "what steps from here come to"
            )
        return caution

    def _all_residuals(self, rest: Equilibrium) -> np.ndarray:
        """Observed less target over the scale, of the entries of targets that are not free."""
        off = [(figure.of(rest.observation) - target) / scale for figure, target, scale in self._figures]
        return np.concatenate(
            [part[np.isfinite(target)] for part, (_, target, _) in zip(off, self._figures, strict=True)]
        )

    def _equilibrium(self, values: np.ndarray) -> Equilibrium:
        """The equilibrium, found from the last one, or from the start where the path counts."""
        key = values.tobytes()
        if self._last is None or self._last[0] != key:
            self._trials += 1
            begin = self._state
            if self._from_start == "motion":
                begin = self._moved(values)
            elif self._from_start is None and self._last is not None:
                begin = self._last[1].state
            try:
                rest = self._statics.find(begin, self._control(values))
            except EquilibriumNotFound:
                if begin is self._state:
                    raise
                rest = self._statics.find(self._state, self._control(values))
            self._last = key, rest
        return self._last[1]

    def _moved(self, values: np.ndarray) -> State:
        stepper, control = TimeStepper(self._model), self._control(values)
        stepper.restore(self._state)
        for _ in range(round(LONGEST / self._model.scene.time.step)):
            before = stepper.state
            stepper.step(control)
            state = stepper.state
            moves = (state.position - before.position, state.rigid_position - before.rigid_position)
            largest = max(float(np.abs(part).max(initial=0.0)) for part in moves)
            same = all(np.array_equal(getattr(state, name), getattr(before, name)) for name in LOADS)
            if same and largest < SLOW * self._model.scene.time.step:
                return state.changed(time=self._state.time, step=self._state.step)
        raise EquilibriumNotFound("", self._state.step, f"still moves after {LONGEST:g} s", "more damping")

    def _control(self, values: np.ndarray) -> Control:
        held = Control(forces=acting_forces(self._statics.model, self._state))
        return asking(self._state, dict(zip(self.names, values.tolist(), strict=True)), held)


def _in_words(missed: list[str], residuals: Mapping[str, np.ndarray], at_bounds: tuple[str, ...]) -> str:
    if not missed:
        return "reached"
    off = ", ".join(f"{name} is off by {np.nanmax(np.abs(residuals[name])):.3g}" for name in missed)
    why = f"; at the end of its range: {', '.join(at_bounds)}" if at_bounds else ""
    return f"not reached, this is the nearest that was found: {off}{why}"


def _checked_bounds(bounds: Mapping[str, Any]) -> np.ndarray:
    """Lowest and highest values, shape (control_count, 2)."""
    if not isinstance(bounds, Mapping) or not bounds:
        raise ControlError("bounds: must be a dictionary with a control or more, such as pressure.finger1.cavity")
    checked = []
    for name, ends in bounds.items():
        try:
            low, high = (float(end) for end in ends)
        except (TypeError, ValueError):
            low, high = np.nan, np.nan
        if not -np.inf < low < high < np.inf:
            raise ControlError(f"bounds['{name}'] = {ends!r}: must be a lowest and a higher finite value")
        checked.append((low, high))
    return np.array(checked)


def _checked_target(name: str, target: Any, seen: np.ndarray) -> np.ndarray:
    """A target as an array of the figure's shape."""
    try:
        array = np.asarray(target, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.full(0, np.nan)
    if array.shape != seen.shape or np.isinf(array).any() or np.isnan(array).all():
        shape = f"an array of shape {seen.shape}" if seen.shape else "a number"
        raise TaichisoftError(f"targets['{name}'] = {target!r}: must be {shape}, finite or NaN where it is free")
    return array
