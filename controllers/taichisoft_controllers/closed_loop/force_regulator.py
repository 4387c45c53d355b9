"""A PI regulator of the grip force, which acts through pressure."""

import math

ROUND_OFF = 1e-9  # of a pressure that is observed [kPa]


class ForceRegulator:
    """Pressure from the error of a force: proportional and integral action, a range, and a rate limit.

    Whenever less is applied than was asked for, because of the range, the rate limit or the limits of a scene, the
    integral is led back to what is applied, with a time constant of its own: back-calculation (Astrom and Murray,
    Feedback Systems, 2nd edition, section 11.4). So it never winds up, and the regulator leaves a limit in the step in
    which the error changes its sign.

    Attributes:
        saturated: whether the last pressure was the highest one, and more was wanted.
    """

    def __init__(
        self,
        proportional_gain: float,
        integral_gain: float,
        tracking_time: float,
        pressure_rate: float,
        lowest_pressure: float,
        highest_pressure: float,
    ):
        """Set the gains and limits.

        Args:
            proportional_gain: [kPa/mN].
            integral_gain: [kPa/(mN s)].
            tracking_time: of the back-calculation [s].
            pressure_rate: fastest change of the pressure, up or down [kPa/s].
            lowest_pressure: [kPa].
            highest_pressure: [kPa].
        """
        self._proportional_gain = proportional_gain
        self._integral_gain = integral_gain
        self._tracking_time = tracking_time
        self._pressure_rate = pressure_rate
        self._lowest = lowest_pressure
        self._highest = highest_pressure
        self.start(lowest_pressure, 0.0)

    def start(self, applied: float, error: float) -> None:
        """Take over from whatever applied the pressure [kPa] at this error [mN], without a jump."""
        self._integral = applied - self._proportional_gain * error
        self._wanted = applied
        self.saturated = False

    def pressure(self, error: float, applied: float, elapsed: float) -> float:
        """The pressure to apply [kPa].

        Args:
            error: set point less force [mN].
            applied: pressure that was applied since the last call [kPa].
            elapsed: time since the last call [s].
        """
        # The exact solution over `elapsed`: an Euler step would be unstable where the tracking time is shorter.
        followed = 1.0 - math.exp(-elapsed / self._tracking_time)
        self._integral += followed * (applied - self._wanted) + self._integral_gain * error * elapsed
        self._wanted = self._integral + self._proportional_gain * error
        self.saturated = self._wanted >= self._highest and applied >= self._highest - ROUND_OFF
        furthest = self._pressure_rate * elapsed
        allowed = min(max(self._wanted, applied - furthest), applied + furthest)
        return min(max(allowed, self._lowest), self._highest)
