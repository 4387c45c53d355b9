"""How hard a grip shall be: as hard as it was told to begin with, and harder when the object slips."""

from taichisoft_controllers.closed_loop.grasp_sensing import Grasp


class GripSetPoint:
    """The set point of a grip force.

    It needs neither the object's weight nor the friction coefficient. An object that slips under a force F tells that
    F is too small: the set point becomes `margin` times F. The force follows, and for as long as the object goes on
    slipping so does the set point. When it sticks, the set point is about `margin` times what that took.

    Attributes:
        force: the set point [mN].
        raised_count: how many times the object slipped, so that it was raised.
    """

    def __init__(self, force: float, margin: float, slip_speed: float):
        """Begin.

        Args:
            force: to begin with [mN].
            margin: over the force at which the object slips [-].
            slip_speed: faster sliding is slip [mm/s].
        """
        self.force = force
        self.raised_count = 0
        self._margin = margin
        self._slip_speed = slip_speed
        self._being_raised = False

    def watch(self, grasp: Grasp, can_follow: bool) -> bool:
        """Whether the object slips; then the set point is raised, if the force `can_follow`."""
        slips = grasp.slip_speed > self._slip_speed
        enough = self._margin * grasp.force
        if slips and can_follow and enough > self.force:
            self.force = enough
            self.raised_count += not self._being_raised
            self._being_raised = True
        self._being_raised = self._being_raised and slips
        return slips
