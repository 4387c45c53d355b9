"""The tuning of the controller "closed-loop": docs/notes/closed_loop.md says how each number was found."""

from typing import Annotated

from pydantic import Field

from taichisoft.scenes import NotNegative, Positive
from taichisoft_controllers.settings import ControllerSettings


class GraspSettings(ControllerSettings):
    """Settings of the controller "closed-loop"."""

    set_point: Positive = 800.0
    """Sum of the normal forces of the fingers on the object, to begin with [mN]."""
    margin: Annotated[float, Field(strict=True, gt=1)] = 1.7
    """Factor over the force at which the object slips, to which the set point is then raised [-]."""
    slip_speed: Positive = 1.0
    """Speed of the lifted object on the fingers, mean weighted by force, from which it slips [mm/s]."""
    highest_pressure: Positive = 105.0
    """Highest pressure that is asked for, if the scene's limit is not lower [kPa]."""
    approach_rate: Positive = 30.0
    """Rate of the pressure until all fingers touch, and when they open [kPa/s]."""
    touch_force: Positive = 5.0
    """Normal force from which a finger counts as touching [mN]."""
    proportional_gain: NotNegative = 0.005
    """Proportional gain of the force regulator [kPa/mN]."""
    integral_gain: Positive = 0.16
    """Integral gain of the force regulator [kPa/(mN s)]."""
    tracking_time: Positive = 0.03
    """Time constant with which the regulator's integral is led back to what was applied [s]."""
    pressure_rate: Positive = 60.0
    """Fastest change of the pressure that the force regulator asks for, up or down [kPa/s]."""
    highest_pull: Positive = 15.0
    """Farthest that cables are pulled in, where there are no cavities, if their stops are not nearer [mm]."""
    pull_approach_speed: Positive = 4.0
    """Speed of the cables until all fingers touch, and when they open [mm/s]."""
    pull_proportional_gain: NotNegative = 0.00012
    """Proportional gain of the force regulator that pulls cables [mm/mN]."""
    pull_integral_gain: Positive = 0.004
    """Integral gain of the force regulator that pulls cables [mm/(mN s)]."""
    pull_speed: Positive = 1.5
    """Fastest motion of the cables that the force regulator asks for, in or out [mm/s]."""
    lift: Positive = 30.0
    """Height by which the base rises [mm]."""
    lift_time: Positive = 2.0
    """Lift duration while nothing slips [s]."""
    hold: Positive = 2.0
    """Duration for which the object must keep its place between the fingers to count as held [s]."""
    stillness: Positive = 1.0
    """Largest motion of an object that keeps its place [mm]."""
    longest_slip: Positive = 20.0
    """Height by which an object may sink between the fingers before it is given up as dropped [mm]."""
    patience: Positive = 15.0
    """Duration after which a grip, a lift or a hold has failed [s]."""
    grasps: Annotated[int, Field(strict=True, gt=0)] = 1
    """Number of grasps: between two it puts the object down and opens, and after the last it goes on holding."""
