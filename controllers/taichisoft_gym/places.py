"""Places where the object of a task can start: not within another body."""

import numpy as np

from taichisoft.bodies import matrices_from_quaternions
from taichisoft.contact import ContactDetection, MovingSurfaces, Overlap, overlaps
from taichisoft.model import Model
from taichisoft.state import State


class FreePlaces:
    """Checks whether the object at another place would overlap another body and be thrown away."""

    def __init__(self, model: Model, start: State, body: str):
        """Make the contact detection.

        Args:
            model: the bodies.
            start: state with the object in its original place; overlaps with its support there do not count.
            body: name of the object.
        """
        self._model, self._body = model, model.body_names.index(body)
        self._moving = MovingSurfaces(model.surfaces)
        self._detection = ContactDetection(model.surfaces, self._moving)
        self._allowed: set[tuple[int, int]] = set()
        self._allowed = {found.bodies for found in self._overlaps(start)}

    def problem(self, state: State) -> str:
        """Overlap of the object in a state, in one line; empty without overlap."""
        return next((found.problem for found in self._overlaps(state)), "")

    def _overlaps(self, state: State) -> list[Overlap]:
        rotation: np.ndarray = matrices_from_quaternions(state.rigid_rotation)
        self._moving.update(state.position, state.rigid_position, rotation)
        found = overlaps(self._model.surfaces, self._moving, self._detection, self._model.body_names, self._body)
        return [one for one in found if one.bodies not in self._allowed]
