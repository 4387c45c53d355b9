"""Valves and regulators of air lines: what has become of what is asked for, after delay and response time."""

import math
from collections.abc import Mapping

import numpy as np

from taichisoft.scenes.air_line import AirLine
from taichisoft.state import State


class Valves:
    """The valves of all cavities with a line.

    Attributes:
        lines: settings by number of the cavity.
    """

    def __init__(self, lines: Mapping[int, AirLine], cavity_count: int, time_step: float):
        """Prepare for a time step [s]."""
        self.lines, self._count, self._time_step = lines, cavity_count, time_step
        self._delays = {number: round(line.delay / time_step) for number, line in lines.items()}

    def start(self) -> dict[str, np.ndarray]:
        """Fields of the first state: a regulator's valve is open, others are closed."""
        opening, supply = np.zeros(self._count), np.zeros(self._count)
        for number, line in self.lines.items():
            opening[number], supply[number] = (1.0, 0.0) if line.supply is None else (0.0, line.supply)
        return {
            "valve_request": opening,
            "valve_opening": opening.copy(),
            "supply_pressure": supply,
            "delayed_requests": np.zeros((self._count, max(self._delays.values(), default=0))),
        }

    def moved(self, state: State, pressure: np.ndarray, request: np.ndarray) -> dict[str, np.ndarray]:
        """Fields of the state that say how valves and regulators are in the step that begins.

        Args:
            state: state at the start of the step.
            pressure: pressures that regulators are asked for, within limits [kPa], shape (cavity_count,).
            request: openings that valves are asked for, from -1 to 1, shape (cavity_count,).
        """
        if not self.lines:
            return {}
        opening, supply = state.valve_opening.copy(), state.supply_pressure.copy()
        waiting = state.delayed_requests.copy()
        for number, line in self.lines.items():
            asked = float((pressure if line.has_regulator else request)[number])
            asked = self._delayed(waiting[number], self._delays[number], asked)
            # First order, exact for a request that stays as it is in the step.
            share = 1.0 if line.response_time == 0.0 else -math.expm1(-self._time_step / line.response_time)
            if line.has_regulator:
                supply[number] += share * (asked - supply[number])
                opening[number] = request[number]
            elif line.period is not None:
                opening[number] = math.copysign(self._share_open(state.step, line.period, abs(asked)), asked)
            else:
                opening[number] += share * (asked - opening[number])
        return {
            "valve_request": request,
            "valve_opening": opening,
            "supply_pressure": supply,
            "delayed_requests": waiting,
        }

    def _delayed(self, waiting: np.ndarray, delay: int, asked: float) -> float:
        """The request of `delay` steps ago; requests on the way move up by one."""
        if not delay:
            return asked
        oldest = float(waiting[0])
        waiting[: delay - 1], waiting[delay - 1] = waiting[1:delay].copy(), asked
        return oldest

    def _share_open(self, step: int, period: float, duty: float) -> float:
        """Share of a step in which an on/off valve is open that opens at the start of each period."""

        def time_open(until: float) -> float:
            periods = math.floor(until / period)
            return periods * duty * period + min(until - periods * period, duty * period)

        start = step * self._time_step
        return min(max((time_open(start + self._time_step) - time_open(start)) / self._time_step, 0.0), 1.0)
