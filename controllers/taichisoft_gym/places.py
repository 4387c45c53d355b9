"""Where the object of a task can stand at the start of an episode: not within another body."""

import numpy as np

from taichisoft.bodies.rotations import matrices_from_quaternions
from taichisoft.contact.detection import ContactDetection
from taichisoft.contact.moving_surfaces import MovingSurfaces
from taichisoft.contact.overlap import Overlap, overlaps
from taichisoft.model import Model
from taichisoft.state import State


class FreePlaces:
    """Tells whether the object, put elsewhere, would overlap another body and be thrown away."""

    def __init__(self, model: Model, start: State, body: str):
        """Prepare.

        Args:
            model: the bodies.
            start: state in which the object stands where it belongs; what it rests on there does not count.
            body: name of the object.
        """
        self._model, self._body = model, model.body_names.index(body)
        self._moving = MovingSurfaces(model.surfaces)
        self._detection = ContactDetection(model.surfaces, self._moving)
        self._allowed: set[tuple[int, int]] = set()
        self._allowed = {found.bodies for found in self._overlaps(start)}

    def problem(self, state: State) -> str:
        """What the object overlaps in a state, in one line; empty where it stands free."""
        return next((found.problem for found in self._overlaps(state)), "")

    def _overlaps(self, state: State) -> list[Overlap]:
        rotation: np.ndarray = matrices_from_quaternions(state.rigid_rotation)
        self._moving.update(state.position, state.rigid_position, rotation)
        found = overlaps(self._model.surfaces, self._moving, self._detection, self._model.body_names, self._body)
        return [one for one in found if one.bodies not in self._allowed]
