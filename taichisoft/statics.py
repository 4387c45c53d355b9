"""Equilibria: where bodies come to rest under their loads, without waiting for it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from taichisoft.building.simulation import Simulation, check_simulation
from taichisoft.caller_warnings import warn_caller
from taichisoft.control.control import Control
from taichisoft.control.observation import Observation
from taichisoft.control.requests import apply_control
from taichisoft.linearisation import Linearisation, linearise
from taichisoft.model import Model
from taichisoft.state import State
from taichisoft.time_stepper import TimeStepper


@dataclass(frozen=True)
class Equilibrium:
    """Bodies at rest.

    Attributes:
        state: the state, with the time of the state from which the search began and no velocities; `Simulation.restore`
            goes on from it.
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
        """Derivatives of what is observed in the equilibrium by what is asked for: its compliance.

        As `Simulation.linearise`, of the equilibrium from here. A contact at the limit of its friction slides on in
        the direction in which friction opposes it, which is where increasing loads have driven it; where they decrease
        it would stick. Contacts do not turn with bodies, which is exact on flat obstacles, and some percent between
        pads and a rigid body.

        Args:
            controls: names of the controls by which to derive, see `Linearisation`; None: by all that can be varied.

        Raises:
            ControlError: a name in `controls` is not that of something which can be varied.
            SceneError: a contact has restitution, spinning or rolling friction.
        """
        self._stepper.restore(self.state)
        return linearise(self._stepper, None, controls)


def equilibrium(simulation: Simulation, control: Control | None = None, stable: bool = True) -> Equilibrium:
    """Find where the bodies of a simulation come to rest; the simulation stays where it is.

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
        control: pressures, pulls, base and so on, as for a step; None: as they were asked for last.
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
    found = statics.find(simulation.state, control, stable)
    if found.warning and stable:
        warn_caller(found.warning)
    simulation.warn_beyond_law(found.state)
    return found


def statics_of(simulation: Simulation) -> "Statics":
    """The static variant of a simulation's model, which it keeps.

    Raises:
        SceneError: a soft body has no anchors.
    """
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
    """

    def __init__(self, model: Model):
        """Make the variant, see `Model.static`."""
        self.set_model(model)

    def set_model(self, model: Model) -> None:
        """Become a variant of another model."""
        self.source = model
        self._stepper = TimeStepper(model.static())
        self.model = self._stepper.model

    def close(self) -> None:
        """Nothing is left open."""

    def find(self, start: State, control: Control, stable: bool = True) -> Equilibrium:
        """The equilibrium under a control, from a state on."""
        stepper = self._stepper
        found = stepper.find_equilibrium(start, apply_control(stepper.model, start, control), stable)
        no_velocity = np.zeros_like(start.frame_velocity)
        memory = found.state.sensor_memory.copy()
        memory[1:2] = 0.0  # sensors have long seen what rests: their samples begin anew
        changes = {"time": start.time, "step": start.step, "frame_velocity": no_velocity, "sensor_memory": memory}
        state = found.state.changed(**changes)
        stepper.restore(state)
        state = stepper.state
        return Equilibrium(
            state=state,
            observation=stepper.observe(),
            linearisations=found.report.linearisations,
            increments=found.increments,
            residual=found.residual,
            stiffness=found.stiffness,
            left=found.left,
            warning=found.warning,
            unchecked=found.unchecked,
            _stepper=stepper,
        )
