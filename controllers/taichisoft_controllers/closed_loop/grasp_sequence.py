"""The phases of a grasp, from open fingers to an object that is held: what each asks for, and when it ends."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from taichisoft.errors import ControllerFailed
from taichisoft_controllers.closed_loop.grasp_actuation import GraspActuation
from taichisoft_controllers.closed_loop.grasp_sensing import SensedGrasp
from taichisoft_controllers.closed_loop.grasp_settings import GraspSettings
from taichisoft_controllers.closed_loop.grip_force import ForceRegulator, GripSetPoint

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
        """Update what is asked for, `elapsed` [s] after the last time.

        Raises:
            ControllerFailed: the object cannot be grasped or lifted, or was dropped.
        """
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
