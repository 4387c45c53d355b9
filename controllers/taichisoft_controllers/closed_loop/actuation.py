"""How the closed loop closes the fingers: by the pressure of their cavities, or by pulling in their cables."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from taichisoft.errors import SceneError
from taichisoft_controllers.closed_loop.grasp_settings import GraspSettings
from taichisoft_controllers.drives import PRESSURE, PULL, Drive

if TYPE_CHECKING:
    from taichisoft.bodies.cables import Cable
    from taichisoft.model import Model
    from taichisoft.scenes.scene import Limits

ROUND_OFF = 1e-9
"""Pressures this close are the same [kPa]."""
PULL_ERROR = 0.01
"""Pulls this close are the same [mm]: a step that turns bodies misses the length that it imposes by about as much."""


@dataclass(frozen=True)
class Actuation:
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


def by_pressure(settings: GraspSettings, lowest: float, highest: float) -> Actuation:
    """Air in cavities, at pressures from `lowest` to `highest` [kPa]."""
    return Actuation(
        PRESSURE,
        lowest,
        highest,
        ROUND_OFF,
        settings.approach_rate,
        settings.proportional_gain,
        settings.integral_gain,
        settings.pressure_rate,
    )


def by_pull(settings: GraspSettings, lowest: float, highest: float) -> Actuation:
    """Cables that are pulled in by `lowest` to `highest` [mm]."""
    return Actuation(
        PULL,
        lowest,
        highest,
        PULL_ERROR,
        settings.pull_approach_speed,
        settings.pull_proportional_gain,
        settings.pull_integral_gain,
        settings.pull_speed,
    )


def actuation_of(model: "Model", settings: GraspSettings) -> Actuation:
    """The cavities of a model; its cables if it has none.

    Raises:
        SceneError: it has neither, or there is nothing to choose from between its limits and those of the settings.
    """
    if model.cavities.names:
        return by_pressure(settings, *_pressure_range(settings, model.scene.limits))
    if model.cables.names:
        return by_pull(settings, *_pull_range(settings, model.cables.all))
    raise SceneError("the scene has no finger with a cavity or a cable, which the controller 'closed-loop' could close")


def _pressure_range(settings: GraspSettings, limits: "Limits") -> tuple[float, float]:
    """The lowest and the highest pressure that may be asked for [kPa]: the settings' within the scene's limits."""
    lowest = max(0.0, limits.lowest_pressure or 0.0)
    highest = settings.highest_pressure
    if limits.highest_pressure is not None:
        highest = min(highest, limits.highest_pressure)
    if not lowest < highest:
        raise SceneError(
            f"controller.settings.highest_pressure = {settings.highest_pressure:g}: within [limits] this "
            f"leaves pressures from {lowest:g} to {highest:g} kPa; the controller 'closed-loop' needs a range"
        )
    return lowest, highest


def _pull_range(settings: GraspSettings, cables: "tuple[Cable, ...]") -> tuple[float, float]:
    """How far cables may be pulled in at least and at most [mm]: the settings' within the stops of all cables."""
    lowest = max(0.0, *(cable.settings.lowest_pull or 0.0 for cable in cables))
    stops = [cable.settings.highest_pull for cable in cables if cable.settings.highest_pull is not None]
    highest = min([settings.highest_pull, *stops])
    if not lowest < highest:
        raise SceneError(
            f"controller.settings.highest_pull = {settings.highest_pull:g}: within the stops of the cables this "
            f"leaves pulls from {lowest:g} to {highest:g} mm; the controller 'closed-loop' needs a range"
        )
    return lowest, highest
