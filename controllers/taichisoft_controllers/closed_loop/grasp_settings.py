"""The tuning of the controller "closed-loop": docs/controllers.md says how each number was found."""

from typing import Annotated

from pydantic import Field

from taichisoft.scenes.scene import NotNegative, Positive, Table


class GraspSettings(Table):
    """What `controller.settings` may say."""

    set_point: Positive = 800.0
    """Sum of the normal forces of the fingers on the object, to begin with [mN]."""
    margin: Annotated[float, Field(strict=True, gt=1)] = 1.7
    """When the object slips, the set point is raised to so many times the force at which it does [-]."""
    slip_speed: Positive = 1.0
    """Sliding of the lifted object on the fingers that counts as slip, mean weighted by force [mm/s]."""
    highest_pressure: Positive = 105.0
    """[kPa], if the scene's limit is not lower."""
    approach_rate: Positive = 30.0
    """Of the pressure until all fingers touch, and when they open [kPa/s]."""
    touch_force: Positive = 5.0
    """Normal force from which a finger counts as touching [mN]."""
    proportional_gain: NotNegative = 0.005
    """Of the force regulator [kPa/mN]."""
    integral_gain: Positive = 0.16
    """Of the force regulator [kPa/(mN s)]."""
    tracking_time: Positive = 0.03
    """In which the regulator's integral is led back to the pressure that was applied [s]."""
    pressure_rate: Positive = 60.0
    """Fastest change of the pressure that the force regulator asks for, up or down [kPa/s]."""
    lift: Positive = 30.0
    """How far the base rises [mm]."""
    lift_time: Positive = 2.0
    """For that, as long as nothing slips [s]."""
    hold: Positive = 2.0
    """How long the object must keep its place between the fingers to count as held [s]."""
    stillness: Positive = 1.0
    """To how much [mm]."""
    longest_slip: Positive = 20.0
    """An object that sinks further than this between the fingers is given up as dropped [mm]."""
    patience: Positive = 15.0
    """A grip, a lift or a hold that takes longer has failed [s]."""
    grasps: Annotated[int, Field(strict=True, gt=0)] = 1
    """How often it grasps: it puts the object down and opens in between, and goes on holding after the last time."""
