"""The controller "closed-loop": grasps by feel, lifts, holds, and squeezes harder when the object slips."""

from typing import TYPE_CHECKING, Any

from taichisoft.control.control import Control
from taichisoft.control.controller import Controller
from taichisoft.control.observation import Observation
from taichisoft.errors import SceneError
from taichisoft.scenes.scene import Limits
from taichisoft_controllers.closed_loop.grasp_sensing import GraspSensing
from taichisoft_controllers.closed_loop.grasp_sequence import GraspSequence, Phase
from taichisoft_controllers.closed_loop.grasp_settings import GraspSettings

if TYPE_CHECKING:
    from taichisoft.model import Model


class ClosedLoopController(Controller):
    """Closes all fingers together until they touch, regulates the sum of their normal forces, and lifts.

    It depends on what it has observed alone. docs/controllers.md has the law, the tuning, and what it can hold.
    """

    def __init__(self, **settings: Any):
        """Take the settings that `GraspSettings` describes.

        Raises:
            SceneError: one of them is not valid.
        """
        self._settings = GraspSettings.checked(**settings)
        self._sequence: GraspSequence | None = None

    def reset(self, model: "Model") -> None:
        """Begin anew.

        Raises:
            SceneError: the model lacks gravity, fingers, cavities, an object to grasp, or pressures to choose from.
        """
        self._sensing = GraspSensing(model, self._settings.touch_force)
        lowest, highest = self._pressure_range(model.scene.limits)
        self._sequence = GraspSequence(self._settings, self._sensing.object, lowest, highest)
        self._first: Observation | None = None
        self._time = 0.0
        self._held_since: float | None = None

    def control(self, observation: Observation) -> Control:
        """The pressure and the height of the base that the present phase of the grasp asks for.

        Raises:
            ControllerFailed: the object cannot be grasped or lifted, or was dropped.
        """
        if self._first is None:
            self._first, self._time = observation, observation.time
        grasp, sequence = self._sensing.sense(observation), self._sequence
        assert sequence is not None, "control() before reset()"
        sequence.advance(grasp, observation.time - self._time)
        self._time = observation.time
        if sequence.phase is Phase.HELD and self._held_since is None:
            self._held_since = observation.time
        return Control(
            pressure=dict.fromkeys(self._sensing.cavities, sequence.pressure),
            base_translation=self._first.base_translation + sequence.height * self._sensing.up,
            signals={
                "phase": float(sequence.phase),
                "set_point": sequence.set_point.force,
                "force": grasp.force,
                "slip_speed": grasp.slip_speed,
                "height": sequence.height,
                "sunk": sequence.sunk,
            },
        )

    def summary(self) -> dict[str, str]:
        """Rows of the table that closes a run."""
        sequence = self._sequence
        if sequence is None:
            return {}
        held = f"held since {self._held_since:.2f} s" if self._held_since is not None else "not held"
        set_point = sequence.set_point
        return {
            f"{self._sensing.object}, closed loop": f"{held}; phase {sequence.phase.name.lower()}",
            "set point of the grip": f"{set_point.force:.0f} mN, raised {set_point.raised_count} times on slip",
            "pressure asked for last": f"{sequence.pressure:.1f} kPa",
        }

    def _pressure_range(self, limits: Limits) -> tuple[float, float]:
        """The lowest and the highest pressure that may be asked for [kPa]: the settings' within the scene's limits."""
        lowest = max(0.0, limits.lowest_pressure or 0.0)
        highest = self._settings.highest_pressure
        if limits.highest_pressure is not None:
            highest = min(highest, limits.highest_pressure)
        if not lowest < highest:
            raise SceneError(
                f"controller.settings.highest_pressure = {self._settings.highest_pressure:g}: within [limits] this "
                f"leaves pressures from {lowest:g} to {highest:g} kPa; the controller 'closed-loop' needs a range"
            )
        return lowest, highest
