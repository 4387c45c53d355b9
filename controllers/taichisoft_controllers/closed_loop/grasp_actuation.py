"""How the closed loop closes the fingers: by the pressure of their cavities, or by pulling in their cables."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from taichisoft.actuators import Drive
from taichisoft.errors import SceneError
from taichisoft_controllers.closed_loop.grasp_settings import GraspSettings
from taichisoft_controllers.drives import PRESSURE, PULL

if TYPE_CHECKING:
    from taichisoft.model import Model

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
    """The cavities of a model, or its cables without cavities, within the limits of scene, cables and settings.

    Raises:
        SceneError: the model has neither, or its limits and the settings leave no range.
    """
    if model.cavities.names:
        limits = model.scene.limits
        lowest = max(0.0, limits.lowest_pressure or 0.0)
        highest = settings.highest_pressure
        if limits.highest_pressure is not None:
            highest = min(highest, limits.highest_pressure)
        found = by_pressure(settings, lowest, highest)
        key, within = f"highest_pressure = {settings.highest_pressure:g}", "[limits]"
    elif model.cables.names:
        cables = [cable.settings for cable in model.cables.all]
        lowest = max(0.0, *(cable.lowest_pull or 0.0 for cable in cables))
        highest = min([settings.highest_pull, *(one.highest_pull for one in cables if one.highest_pull is not None)])
        found = by_pull(settings, lowest, highest)
        key, within = f"highest_pull = {settings.highest_pull:g}", "the stops of the cables"
    else:
        raise SceneError("the scene has no finger with a cavity or a cable for the controller 'closed-loop' to close")
    if not lowest < highest:
        raise SceneError(
            f"controller.settings.{key}: within {within} this leaves {found.drive.name}s from {lowest:g} to "
            f"{highest:g} {found.drive.unit}; the controller 'closed-loop' needs a range"
        )
    return found
