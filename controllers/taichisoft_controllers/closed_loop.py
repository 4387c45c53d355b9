"""The controller "closed-loop": grasps by feel, lifts, holds, and squeezes harder when the object slips."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.control import Control, Controller, Observation
from taichisoft.errors import ControllerFailed, SceneError
from taichisoft.mechanics import Drive
from taichisoft_controllers.grasp_sensing import GraspSensing, GraspSettings, SensedGrasp
from taichisoft_controllers.settings import PRESSURE, PULL, tunable_settings

if TYPE_CHECKING:
    from taichisoft.contact import Model

# How the closed loop closes the fingers: by the pressure of their cavities, or by pulling in their cables.

ROUND_OFF = 1e-9
"""Pressures this close are the same [kPa]."""
PULL_ERROR = 0.01
"""Pulls this close are the same [mm]: a step that turns bodies misses the length that it imposes by about as much."""


@dataclass(frozen=True)
class GraspActuation:
    """The quantity that closes the fingers, the same for all, with its range and the tuning that belongs to its unit.

    Attributes:
        drive: the quantity: its unit below is kPa or mm.
        lowest: that of open fingers.
        highest: the highest that is asked for.
        near: values this close are the same.
        approach_rate: rate until all fingers touch, and when they open [unit/s].
        proportional_gain: of the force regulator [unit/mN].
        integral_gain: of the force regulator [unit/(mN s)].
        rate: fastest change that the force regulator asks for, up or down [unit/s].
    """

    drive: Drive
    lowest: float
    highest: float
    near: float
    approach_rate: float
    proportional_gain: float
    integral_gain: float
    rate: float


def by_pressure(settings: GraspSettings, lowest: float, highest: float) -> GraspActuation:
    """Air in cavities, at pressures from `lowest` to `highest` [kPa]."""
    gains = settings.proportional_gain, settings.integral_gain
    return GraspActuation(PRESSURE, lowest, highest, ROUND_OFF, settings.approach_rate, *gains, settings.pressure_rate)


def by_pull(settings: GraspSettings, lowest: float, highest: float) -> GraspActuation:
    """Cables that are pulled in by `lowest` to `highest` [mm]."""
    gains = settings.pull_proportional_gain, settings.pull_integral_gain
    return GraspActuation(PULL, lowest, highest, PULL_ERROR, settings.pull_approach_speed, *gains, settings.pull_speed)


def actuation_of(model: "Model", settings: GraspSettings) -> GraspActuation:
    """The cavities of a model, or its cables without cavities, within the limits of scene, cables and settings."""
    if model.cavities.names:
        limits = model.scene.limits
        lowest = max(0.0, limits.lowest_pressure or 0.0)
        highest = settings.highest_pressure
        if limits.highest_pressure is not None:
            highest = min(highest, limits.highest_pressure)
        actuation = by_pressure(settings, lowest, highest)
        key, within = f"highest_pressure = {settings.highest_pressure:g}", "[limits]"
    elif model.cables.names:
        cables = [cable.settings for cable in model.cables.all]
        lowest = max(0.0, *(cable.lowest_pull or 0.0 for cable in cables))
        highest = min(
            [settings.highest_pull, *(cable.highest_pull for cable in cables if cable.highest_pull is not None)]
        )
        actuation = by_pull(settings, lowest, highest)
        key, within = f"highest_pull = {settings.highest_pull:g}", "the stops of the cables"
    else:
        raise SceneError("the scene has no finger with a cavity or a cable for the controller 'closed-loop' to close")
    if not lowest < highest:
        raise SceneError(
            f"controller.settings.{key}: within {within} this leaves {actuation.drive.name}s from {lowest:g} to "
            f"{highest:g} {actuation.drive.unit}; the controller 'closed-loop' needs a range"
        )
    return actuation


# The force of a grip: how hard it shall be, and the pressure or pull that makes it so.


@dataclass
class GripSetPoint:
    """The set point of a grip force, which rises when the object slips.

    Neither the object's weight nor the friction coefficient is needed. An object that slips under a force F shows that
    F is too small: the set point becomes `margin` times F. The force follows, and for as long as the object goes on
    slipping so does the set point. When it sticks, the set point is about `margin` times what that took.

    Attributes:
        force: the set point [mN].
        margin: factor over the force at which the object slips [-].
        slip_speed: speed of sliding that counts as slip [mm/s].
        raised_count: how many times the object slipped, so that the set point was raised.
    """

    force: float
    margin: float
    slip_speed: float
    raised_count: int = 0
    _being_raised: bool = False

    def save(self) -> dict[str, Any]:
        """What slips have raised the set point to, None where none has."""
        raised = self.force if self.raised_count else None
        return {"raised_to": raised, "raised_count": self.raised_count, "being_raised": self._being_raised}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on from what `save` gave; a set point that was never raised is that of the settings."""
        self.force = self.force if saved["raised_to"] is None else saved["raised_to"]
        self.raised_count, self._being_raised = saved["raised_count"], saved["being_raised"]

    def watch(self, grasp: SensedGrasp, can_follow: bool) -> bool:
        """Raise the set point if the object slips and the force `can_follow`; returns whether it slips."""
        slips = grasp.slip_speed > self.slip_speed
        enough = self.margin * grasp.force
        if slips and can_follow and enough > self.force:
            self.force = enough
            self.raised_count += not self._being_raised
            self._being_raised = True
        self._being_raised = self._being_raised and slips
        return slips


@dataclass
class ForceRegulator:
    """A PI regulator of the grip force, which acts through pressure or pull, within a range and a rate limit.

    Whenever less is applied than was asked for, because of the range, the rate limit or the limits of a scene, the
    integral is led back to what is applied, with a time constant of its own: back-calculation (Astrom and Murray,
    Feedback Systems, 2nd edition, section 11.4). So it never winds up, and the regulator leaves a limit in the step in
    which the error changes its sign.

    Attributes:
        actuation: what it acts through, with the gains, the range and the rate limit.
        tracking_time: the time constant [s].
        saturated: whether the last command was the highest one, although the error asked for more.
    """

    actuation: GraspActuation
    tracking_time: float

    def __post_init__(self) -> None:
        self.start(self.actuation.lowest, 0.0)

    def start(self, applied: float, error: float) -> None:
        """Take over from whatever applied a pressure [kPa] or pull [mm] at this error [mN], without a jump."""
        self._integral = applied - self.actuation.proportional_gain * error
        self._wanted = applied
        self.saturated = False

    def save(self) -> dict[str, Any]:
        """The integral, and what was wanted last."""
        return {"integral": self._integral, "wanted": self._wanted, "saturated": self.saturated}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on from what `save` gave."""
        self._integral, self._wanted, self.saturated = saved["integral"], saved["wanted"], saved["saturated"]

    def command(self, error: float, applied: float, elapsed: float) -> float:
        """The pressure [kPa] or pull [mm] to apply.

        Args:
            error: set point less force [mN].
            applied: what was applied since the last call [kPa] or [mm].
            elapsed: time since the last call [s].
        """
        by = self.actuation
        # The exact solution over `elapsed`: an Euler step would be unstable where the tracking time is shorter.
        followed = 1.0 - math.exp(-elapsed / self.tracking_time)
        self._integral += followed * (applied - self._wanted) + by.integral_gain * error * elapsed
        self._wanted = self._integral + by.proportional_gain * error
        self.saturated = self._wanted >= by.highest and applied >= by.highest - by.near
        furthest = by.rate * elapsed
        allowed = min(max(self._wanted, applied - furthest), applied + furthest)
        return min(max(allowed, by.lowest), by.highest)


# The phases of a grasp, from open fingers to an object that is held: what each asks for, and when it ends.

SETTLED = 0.05
"""Share of the set point by which a force that has reached it may differ from it [-]."""
SETTLING_TIME = 0.2
"""Duration for which the condition that ends a phase must be true [s]."""
WAITING_TIME = 0.1
"""Time constant with which a lift stops and goes on [s]; the fingers follow their base no faster."""
RESTING_SPEED = 1.0
"""Speed below which the object has arrived [mm/s]."""
TIME_ROUND_OFF = 1e-9
"""Times this close are the same [s]."""


class Phase(IntEnum):
    """The phases of a grasp, by their numbers in the signal `phase`."""

    APPROACH = 1
    GRIP = 2
    LIFT = 3
    HOLD = 4
    HELD = 5
    LOWER = 6
    RELEASE = 7


class GraspSequence:
    """Goes through the phases.

    Attributes:
        phase: the present one.
        command: pressure to apply to all cavities [kPa], or pull to all cables [mm].
        height: where the base shall be, upwards from its start [mm].
        set_point: set point of the sum of the normal forces of the fingers.
        sunk: how far the object is below where the last lift took it up, relative to the base [mm].
    """

    def __init__(self, settings: GraspSettings, object_name: str, actuation: GraspActuation):
        """Begin with open fingers.

        Args:
            settings: the tuning.
            object_name: name of the object in messages.
            actuation: what closes the fingers.
        """
        self.phase = Phase.APPROACH
        self.command = actuation.lowest
        self.height = 0.0
        self.set_point = GripSetPoint(settings.set_point, settings.margin, settings.slip_speed)
        self.sunk = 0.0
        self._settings = settings
        self._object = object_name
        self._actuation = actuation
        self._regulator = ForceRegulator(actuation, settings.tracking_time)
        self._phase_begun = 0.0
        self._true_since: float | None = None
        self._grasps_made = 0
        self._taken_up = self._held_at = self._held_since = 0.0
        self._profile = LiftProfile(0.0, 0.0, settings.lift_time, WAITING_TIME)
        self._advance = {
            Phase.APPROACH: self._approach,
            Phase.GRIP: self._grip,
            Phase.LIFT: self._lift,
            Phase.HOLD: self._hold,
            Phase.HELD: self._keep_holding,
            Phase.LOWER: self._lower,
            Phase.RELEASE: self._release,
        }

    def advance(self, grasp: SensedGrasp, elapsed: float) -> None:
        """Update what is asked for, `elapsed` [s] after the last time."""
        self._advance[self.phase](grasp, elapsed)

    def save(self) -> dict[str, Any]:
        """The phase, what it asks for, and the times and heights that it compares with."""
        return {
            "phase": int(self.phase),
            "command": self.command,
            "height": self.height,
            "sunk": self.sunk,
            "phase_begun": self._phase_begun,
            "true_since": self._true_since,
            "grasps_made": self._grasps_made,
            "taken_up": self._taken_up,
            "held_at": self._held_at,
            "held_since": self._held_since,
            "set_point": self.set_point.save(),
            "regulator": self._regulator.save(),
            "profile": vars(self._profile).copy(),
        }

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on from what `save` gave."""
        self.phase, self.command = Phase(saved["phase"]), saved["command"]
        self.height, self.sunk = saved["height"], saved["sunk"]
        self._phase_begun, self._true_since = saved["phase_begun"], saved["true_since"]
        self._grasps_made, self._taken_up = saved["grasps_made"], saved["taken_up"]
        self._held_at, self._held_since = saved["held_at"], saved["held_since"]
        self.set_point.restore(saved["set_point"])
        self._regulator.restore(saved["regulator"])
        self._profile = LiftProfile(**saved["profile"])

    def _approach(self, grasp: SensedGrasp, elapsed: float) -> None:
        """Close until all fingers touch."""
        by = self._actuation
        self.command = min(grasp.applied + by.approach_rate * elapsed, by.highest)
        if not grasp.missing:
            self._regulator.start(grasp.applied, self.set_point.force - grasp.force)
            self._enter(Phase.GRIP, grasp)
        elif self._settled(grasp.applied >= by.highest - by.near, grasp):
            self._fail(grasp, f"no contact of {', '.join(grasp.missing)} up to {by.highest:g} {by.drive.unit}")

    def _grip(self, grasp: SensedGrasp, elapsed: float) -> None:
        """Press until the force is there; a raised set point counts as reached at the highest command."""
        self._regulate(grasp, elapsed)
        reached = abs(self.set_point.force - grasp.force) < SETTLED * self.set_point.force
        strongest = self._regulator.saturated and grasp.force > self._settings.set_point
        if self._settled(reached or strongest, grasp):
            self._taken_up = grasp.offset
            self._plan_rise(self._settings.lift)
            self._enter(Phase.LIFT, grasp)
        else:
            self._fail_if_late(grasp, "the force does not settle")

    def _lift(self, grasp: SensedGrasp, elapsed: float) -> None:
        """Rise, but wait while the object slips; going on as soon as it sticks shows whether it does."""
        slips = self._watch(grasp)
        self._regulate(grasp, elapsed)
        self.height = self._profile.advance(elapsed, waits=slips)
        arrived = self._profile.finished and not grasp.base_held_back
        if self._settled(arrived and grasp.object_speed < RESTING_SPEED, grasp):
            self._restart_hold(grasp)
            self._enter(Phase.HOLD, grasp)
        else:
            self._fail_if_late(grasp, f"'{self._object}' is not lifted")

    def _hold(self, grasp: SensedGrasp, elapsed: float) -> None:
        """Wait until the object has kept its place for long enough."""
        slips = self._watch(grasp)
        self._regulate(grasp, elapsed)
        if slips or abs(grasp.offset - self._held_at) > self._settings.stillness:
            self._restart_hold(grasp)
        if grasp.time - self._held_since > self._settings.hold + TIME_ROUND_OFF:
            self._grasps_made += 1
            if self._grasps_made == self._settings.grasps:
                self._enter(Phase.HELD, grasp)
            else:
                self._plan_rise(-self._settings.lift)
                self._enter(Phase.LOWER, grasp)
        else:
            self._fail_if_late(grasp, f"'{self._object}' does not keep its place")

    def _keep_holding(self, grasp: SensedGrasp, elapsed: float) -> None:
        """Go on as in the hold, to the end of the run."""
        self._watch(grasp)
        self._regulate(grasp, elapsed)

    def _lower(self, grasp: SensedGrasp, elapsed: float) -> None:
        """Put the object down where it stood."""
        self._regulate(grasp, elapsed)
        self.height = self._profile.advance(elapsed, waits=False)
        if self._settled(self._profile.finished and not grasp.base_held_back, grasp):
            self._enter(Phase.RELEASE, grasp)

    def _release(self, grasp: SensedGrasp, elapsed: float) -> None:
        """Open the fingers."""
        by = self._actuation
        self.command = max(grasp.applied - by.approach_rate * elapsed, by.lowest)
        if self._settled(grasp.applied <= by.lowest + by.near, grasp):
            self._enter(Phase.APPROACH, grasp)

    def _regulate(self, grasp: SensedGrasp, elapsed: float) -> None:
        self.command = self._regulator.command(self.set_point.force - grasp.force, grasp.applied, elapsed)

    def _watch(self, grasp: SensedGrasp) -> bool:
        """Raise the set point if the lifted object slips; returns whether it does."""
        self.sunk = self._taken_up - grasp.offset
        if self.sunk > self._settings.longest_slip:
            self._fail(grasp, f"dropped '{self._object}', which sank by {self.sunk:.1f} mm")
        return self.set_point.watch(grasp, can_follow=not self._regulator.saturated)

    def _plan_rise(self, rise: float) -> None:
        self._profile = LiftProfile(self.height, self.height + rise, self._settings.lift_time, WAITING_TIME)

    def _restart_hold(self, grasp: SensedGrasp) -> None:
        self._held_at, self._held_since = grasp.offset, grasp.time

    def _enter(self, phase: Phase, grasp: SensedGrasp) -> None:
        self.phase, self._phase_begun, self._true_since = phase, grasp.time, None

    def _settled(self, condition: bool, grasp: SensedGrasp) -> bool:
        """Whether the condition that ends the phase has been true for long enough."""
        if not condition:
            self._true_since = None
        elif self._true_since is None:
            self._true_since = grasp.time
        return self._true_since is not None and grasp.time - self._true_since >= SETTLING_TIME - TIME_ROUND_OFF

    def _fail_if_late(self, grasp: SensedGrasp, what: str) -> None:
        if grasp.time - self._phase_begun > self._settings.patience + TIME_ROUND_OFF:
            self._fail(grasp, f"{what} within {self._settings.patience:g} s")

    def _fail(self, grasp: SensedGrasp, reason: str) -> None:
        raise ControllerFailed(
            f"{self.phase.name.lower()} failed at {grasp.time:.2f} s: {reason}; the fingers press with "
            f"{grasp.force:.0f} of {self.set_point.force:.0f} mN at {grasp.applied:.1f} {self._actuation.drive.unit}"
        )


@dataclass
class LiftProfile:
    """The minimum-jerk profile (Flash and Hogan 1985): at rest at both ends, and nowhere a jump of acceleration.

    Its own time stands still while it waits. It slows down and goes on within `wait_time`, by a first-order lag, so
    that waiting does not jerk either.

    Attributes:
        start, end: heights at both ends [mm].
        duration: time from start to end without waiting [s].
        wait_time: time constant of slowing down and going on [s].
    """

    start: float
    end: float
    duration: float
    wait_time: float
    _time: float = 0.0
    _pace: float = 1.0

    @property
    def finished(self) -> bool:
        """Whether the end is reached."""
        return self._time >= self.duration

    def advance(self, elapsed: float, waits: bool) -> float:
        """The height [mm], `elapsed` [s] later."""
        wanted = 0.0 if waits else 1.0
        self._pace += (wanted - self._pace) * (1.0 - math.exp(-elapsed / self.wait_time))
        self._time += self._pace * elapsed
        share = min(self._time / self.duration, 1.0)
        return self.start + (self.end - self.start) * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


class ClosedLoopController(Controller):
    """Closes all fingers together until they touch, regulates the sum of their normal forces, and lifts.

    It depends on what it has observed alone. docs/controllers.md has the law, the tuning, and what it can hold.

    Attributes:
        tunable: all of its settings that are not numbers of grasps.
    """

    tunable = tunable_settings(GraspSettings)

    def __init__(self, **settings: Any):
        """Take the settings that `GraspSettings` describes."""
        self._settings = GraspSettings.checked(**settings)
        self._sequence: GraspSequence | None = None

    def reset(self, model: "Model") -> None:
        """Begin the grasp from its first phase."""
        self._actuation = actuation_of(model, self._settings)
        self._sensing = GraspSensing(model, self._actuation.drive, self._settings.touch_force)
        self._sequence = GraspSequence(self._settings, self._sensing.object, self._actuation)
        self._base: np.ndarray | None = None
        self._time = 0.0
        self._held_since: float | None = None

    def control(self, observation: Observation) -> Control:
        """The pressure or pull and the height of the base that the present phase of the grasp asks for."""
        if self._base is None:
            self._base, self._time = observation.base_translation, observation.time
        sequence = self._sequence
        assert sequence is not None, "control() before reset()"
        grasp = self._sensing.sense(observation, sequence.command)
        sequence.advance(grasp, observation.time - self._time)
        self._time = observation.time
        if sequence.phase is Phase.HELD and self._held_since is None:
            self._held_since = observation.time
        commands = dict.fromkeys(self._sensing.actuators, sequence.command)
        by_pressure = self._actuation.drive is PRESSURE
        return Control(
            pressure=commands if by_pressure else {},
            cable_pull={} if by_pressure else commands,
            base_translation=self._base + sequence.height * self._sensing.up,
            signals={
                "phase": float(sequence.phase),
                "set_point": sequence.set_point.force,
                "force": grasp.force,
                "slip_speed": grasp.slip_speed,
                "height": sequence.height,
                "sunk": sequence.sunk,
            },
        )

    def save(self) -> dict[str, Any]:
        """Where the base began, how far the grasp is, and what its sensing and its regulator have learnt."""
        assert self._sequence is not None, "save() before reset()"
        return {
            "base": self._base.tolist() if self._base is not None else None,
            "time": self._time,
            "held_since": self._held_since,
            "friction": self._sensing.save(),
            "grasp": self._sequence.save(),
        }

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on in the same phase, with the present settings; a set point that slips have raised stays raised."""
        assert self._sequence is not None, "restore() before reset()"
        self._base = np.array(saved["base"]) if saved["base"] is not None else None
        self._time, self._held_since = saved["time"], saved["held_since"]
        self._sensing.restore(saved["friction"])
        self._sequence.restore(saved["grasp"])

    def summary(self) -> dict[str, str]:
        """Rows of the table that closes a run."""
        sequence = self._sequence
        if sequence is None:
            return {}
        held = f"held since {self._held_since:.2f} s" if self._held_since is not None else "not held"
        set_point, drive = sequence.set_point, self._actuation.drive
        return {
            f"{self._sensing.object}, closed loop": f"{held}; phase {sequence.phase.name.lower()}",
            "set point of the grip": f"{set_point.force:.0f} mN, raised {set_point.raised_count} times on slip",
            f"{drive.name} asked for last": f"{sequence.command:.1f} {drive.unit}",
        }
