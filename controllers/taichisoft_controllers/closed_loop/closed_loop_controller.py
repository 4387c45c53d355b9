"""The controller "closed-loop": grasps by feel, lifts, holds, and squeezes harder when the object slips."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.control import Control, Controller, Observation
from taichisoft_controllers.closed_loop.grasp_actuation import actuation_of
from taichisoft_controllers.closed_loop.grasp_sensing import GraspSensing
from taichisoft_controllers.closed_loop.grasp_sequence import GraspSequence, Phase
from taichisoft_controllers.closed_loop.grasp_settings import GraspSettings
from taichisoft_controllers.drives import PRESSURE
from taichisoft_controllers.settings import tunable_settings

if TYPE_CHECKING:
    from taichisoft.model import Model


class ClosedLoopController(Controller):
    """Closes all fingers together until they touch, regulates the sum of their normal forces, and lifts.

    It depends on what it has observed alone. docs/controllers.md has the law, the tuning, and what it can hold.

    Attributes:
        tunable: all of its settings that are not numbers of grasps.
    """

    tunable = tunable_settings(GraspSettings)

    def __init__(self, **settings: Any):
        """Take the settings that `GraspSettings` describes.

        Raises:
            SceneError: one of them is not valid.
        """
        self._settings = GraspSettings.checked(**settings)
        self._sequence: GraspSequence | None = None

    def reset(self, model: "Model") -> None:
        """Begin the grasp from its first phase.

        Raises:
            SceneError: the model lacks gravity, fingers, cavities and cables, an object to grasp, or pressures or pulls
                to choose from.
        """
        self._actuation = actuation_of(model, self._settings)
        self._sensing = GraspSensing(model, self._actuation.drive, self._settings.touch_force)
        self._sequence = GraspSequence(self._settings, self._sensing.object, self._actuation)
        self._base: np.ndarray | None = None
        self._time = 0.0
        self._held_since: float | None = None

    def control(self, observation: Observation) -> Control:
        """The pressure or pull and the height of the base that the present phase of the grasp asks for.

        Raises:
            ControllerFailed: the object cannot be grasped or lifted, or was dropped.
        """
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
