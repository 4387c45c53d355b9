"""The phases of a grasp, from open fingers to an object that is held: what each asks for, and when it ends."""

from enum import IntEnum

from taichisoft.errors import ControllerFailed
from taichisoft_controllers.closed_loop.force_regulator import ROUND_OFF, ForceRegulator
from taichisoft_controllers.closed_loop.grasp_sensing import Grasp
from taichisoft_controllers.closed_loop.grasp_settings import GraspSettings
from taichisoft_controllers.closed_loop.grip_set_point import GripSetPoint
from taichisoft_controllers.closed_loop.lift_profile import LiftProfile
from taichisoft_controllers.closed_loop.phase_clock import PhaseClock

SETTLED = 0.05  # of the set point: closer than this the force has reached it
SETTLING_TIME = 0.2  # for so long must be true what ends a phase [s]
WAITING_TIME = 0.1  # in which a lift stops and goes on [s]: the fingers follow their base no faster
RESTING_SPEED = 1.0  # slower than this the object has arrived [mm/s]


class Phase(IntEnum):
    """What a grasp is about."""

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
        pressure: to apply to all cavities [kPa].
        height: where the base shall be, upwards from its start [mm].
        set_point: of the sum of the normal forces of the fingers.
        sunk: how far the object is below where the last lift took it up, relative to the base [mm].
    """

    def __init__(self, settings: GraspSettings, object_name: str, lowest_pressure: float, highest_pressure: float):
        """Begin with open fingers.

        Args:
            settings: the tuning.
            object_name: for messages.
            lowest_pressure: [kPa].
            highest_pressure: [kPa].
        """
        self.phase = Phase.APPROACH
        self.pressure = lowest_pressure
        self.height = 0.0
        self.set_point = GripSetPoint(settings.set_point, settings.margin, settings.slip_speed)
        self.sunk = 0.0
        self._settings = settings
        self._object = object_name
        self._lowest, self._highest = lowest_pressure, highest_pressure
        self._regulator = ForceRegulator(
            settings.proportional_gain,
            settings.integral_gain,
            settings.tracking_time,
            settings.pressure_rate,
            lowest_pressure,
            highest_pressure,
        )
        self._clock, self._hold_clock = PhaseClock(), PhaseClock()
        self._grasps_made = 0
        self._advance = {
            Phase.APPROACH: self._approach,
            Phase.GRIP: self._grip,
            Phase.LIFT: self._lift,
            Phase.HOLD: self._hold,
            Phase.HELD: self._keep_holding,
            Phase.LOWER: self._lower,
            Phase.RELEASE: self._release,
        }

    def advance(self, grasp: Grasp, elapsed: float) -> None:
        """Update what is asked for, `elapsed` [s] after the last time.

        Raises:
            ControllerFailed: the object cannot be grasped or lifted, or was dropped.
        """
        self._advance[self.phase](grasp, elapsed)

    def _approach(self, grasp: Grasp, elapsed: float) -> None:
        """Close until all fingers touch."""
        self.pressure = min(grasp.pressure + self._settings.approach_rate * elapsed, self._highest)
        if not grasp.missing:
            self._regulator.start(grasp.pressure, self.set_point.force - grasp.force)
            self._enter(Phase.GRIP, grasp)
        elif self._settled(grasp.pressure >= self._highest - ROUND_OFF, grasp):
            self._fail(grasp, f"no contact of {', '.join(grasp.missing)} up to {self._highest:g} kPa")

    def _grip(self, grasp: Grasp, elapsed: float) -> None:
        """Press until the force is there; of a set point that was raised, as much as the highest pressure gives."""
        self._regulate(grasp, elapsed)
        reached = abs(self.set_point.force - grasp.force) < SETTLED * self.set_point.force
        strongest = self._regulator.saturated and grasp.force > self._settings.set_point
        if self._settled(reached or strongest, grasp):
            self._taken_up = grasp.offset
            self._plan_rise(self._settings.lift)
            self._enter(Phase.LIFT, grasp)
        else:
            self._fail_if_late(grasp, "the force does not settle")

    def _lift(self, grasp: Grasp, elapsed: float) -> None:
        """Rise, but wait while the object slips; going on as soon as it sticks shows whether it does."""
        slips = self._watch(grasp)
        self._regulate(grasp, elapsed)
        self.height = self._profile.advance(elapsed, waits=slips)
        arrived = self._profile.finished and not grasp.base_held_back
        if self._settled(arrived and grasp.object_speed < RESTING_SPEED, grasp):
            self._hold_anew(grasp)
            self._enter(Phase.HOLD, grasp)
        else:
            self._fail_if_late(grasp, f"'{self._object}' is not lifted")

    def _hold(self, grasp: Grasp, elapsed: float) -> None:
        """Wait until the object has kept its place for long enough."""
        slips = self._watch(grasp)
        self._regulate(grasp, elapsed)
        if slips or abs(grasp.offset - self._held_at) > self._settings.stillness:
            self._hold_anew(grasp)
        if self._hold_clock.exceeds(self._settings.hold, grasp.time):
            self._grasps_made += 1
            if self._grasps_made == self._settings.grasps:
                self._enter(Phase.HELD, grasp)
            else:
                self._plan_rise(-self._settings.lift)
                self._enter(Phase.LOWER, grasp)
        else:
            self._fail_if_late(grasp, f"'{self._object}' does not keep its place")

    def _keep_holding(self, grasp: Grasp, elapsed: float) -> None:
        """The job is done; go on."""
        self._watch(grasp)
        self._regulate(grasp, elapsed)

    def _lower(self, grasp: Grasp, elapsed: float) -> None:
        """Put the object down where it stood."""
        self._regulate(grasp, elapsed)
        self.height = self._profile.advance(elapsed, waits=False)
        if self._settled(self._profile.finished and not grasp.base_held_back, grasp):
            self._enter(Phase.RELEASE, grasp)

    def _release(self, grasp: Grasp, elapsed: float) -> None:
        """Open."""
        self.pressure = max(grasp.pressure - self._settings.approach_rate * elapsed, self._lowest)
        if self._settled(grasp.pressure <= self._lowest + ROUND_OFF, grasp):
            self._enter(Phase.APPROACH, grasp)

    def _regulate(self, grasp: Grasp, elapsed: float) -> None:
        self.pressure = self._regulator.pressure(self.set_point.force - grasp.force, grasp.pressure, elapsed)

    def _watch(self, grasp: Grasp) -> bool:
        """Whether the lifted object slips."""
        self.sunk = self._taken_up - grasp.offset
        if self.sunk > self._settings.longest_slip:
            self._fail(grasp, f"dropped '{self._object}', which sank by {self.sunk:.1f} mm")
        return self.set_point.watch(grasp, can_follow=not self._regulator.saturated)

    def _plan_rise(self, rise: float) -> None:
        self._profile = LiftProfile(self.height, self.height + rise, self._settings.lift_time, WAITING_TIME)

    def _hold_anew(self, grasp: Grasp) -> None:
        self._held_at = grasp.offset
        self._hold_clock.restart(grasp.time)

    def _enter(self, phase: Phase, grasp: Grasp) -> None:
        self.phase = phase
        self._clock.restart(grasp.time)

    def _settled(self, condition: bool, grasp: Grasp) -> bool:
        return self._clock.has_lasted(condition, SETTLING_TIME, grasp.time)

    def _fail_if_late(self, grasp: Grasp, what: str) -> None:
        if self._clock.exceeds(self._settings.patience, grasp.time):
            self._fail(grasp, f"{what} within {self._settings.patience:g} s")

    def _fail(self, grasp: Grasp, reason: str) -> None:
        raise ControllerFailed(
            f"{self.phase.name.lower()} failed at {grasp.time:.2f} s: {reason}; the fingers press with "
            f"{grasp.force:.0f} of {self.set_point.force:.0f} mN at {grasp.pressure:.1f} kPa"
        )
