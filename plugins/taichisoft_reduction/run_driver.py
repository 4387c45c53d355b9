"""What drives a run of the training: a timetable, or the scene's own controller with other efforts."""

from dataclasses import replace
from typing import Any

import numpy as np

from taichisoft import Control, Controller, Model, Observation
from taichisoft.actuators import ACTUATOR_KINDS
from taichisoft_reduction.run_request import Timetable

DRIVES = tuple(drive.asked for kind in ACTUATOR_KINDS for drive in (kind.effort, kind.coordinate))
AXES = ("x", "y", "z")


class TimetableController(Controller):
    """Asks for what a timetable says."""

    def __init__(self, timetable: Timetable):
        """Follow `timetable`."""
        self._timetable = timetable
        self._keys = sorted({channel.partition("/")[0] for channel in timetable.channels})

    def control(self, observation: Observation) -> Control:
        """The values at the end of the step."""
        end = observation.time + observation.control_period
        now = {
            channel: float(np.interp(end, self._timetable.times, values))
            for channel, values in self._timetable.channels.items()
        }
        asked: dict[str, object] = {}
        for key in self._keys:
            own = {name: value for (one, _, name), value in _split(now) if one == key}
            asked[key] = own if key in DRIVES else np.array([own.get(axis, 0.0) for axis in AXES])
        return Control(**asked)  # type: ignore[arg-type]


def _split(values: dict[str, float]) -> list[tuple[tuple[str, str, str], float]]:
    return [(channel.partition("/"), value) for channel, value in values.items()]


class ScaledController(Controller):
    """Another controller, whose pressures, volumes, tensions and pulls are multiplied by a factor."""

    def __init__(self, controller: Controller, factor: float):
        """Scale what `controller` asks for by `factor`."""
        self._controller, self._factor = controller, factor

    def reset(self, model: Model) -> None:
        """See `Controller`."""
        self._controller.reset(model)

    def control(self, observation: Observation) -> Control:
        """See `Controller`."""
        asked = self._controller.control(observation)
        scaled: dict[str, Any] = {
            key: {name: self._factor * value for name, value in getattr(asked, key).items()}
            for key in DRIVES
            if getattr(asked, key)
        }
        return replace(asked, **scaled) if scaled else asked
