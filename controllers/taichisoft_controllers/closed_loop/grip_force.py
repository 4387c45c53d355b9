"""The force of a grip: how hard it shall be, and the pressure or pull that makes it so."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from taichisoft_controllers.closed_loop.grasp_actuation import GraspActuation
from taichisoft_controllers.closed_loop.grasp_sensing import SensedGrasp


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
