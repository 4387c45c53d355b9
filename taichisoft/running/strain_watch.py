"""Says once when a body is stretched beyond what its law is good for."""

from taichisoft.bodies.strain import Stretches, valid_stretch
from taichisoft.model import Model
from taichisoft.state import State

EVERY = 20
"""Steps from one look to the next: a look takes about as long as a step without contact."""


class StrainWatch:
    """Looks at the stretches of all soft bodies now and then, until it has found one that is too large."""

    def __init__(self, model: Model):
        """Prepare; costs nothing without soft bodies."""
        self._bodies = model.soft_bodies
        self._stretches = [Stretches(body.rest_position, body.elements) for body in self._bodies]
        self._waiting = bool(self._bodies)

    def complaint(self, state: State) -> str | None:
        """The line to show, where this is the first state beyond the range; None else."""
        if not self._waiting or state.step % EVERY:
            return None
        for body, stretches in zip(self._bodies, self._stretches, strict=True):
            position = state.position[body.nodes]
            found = stretches.largest(position)
            limit, law = valid_stretch(body.settings)
            worst = int(found.argmax())
            if found[worst] > limit:
                self._waiting = False
                x, y, z = position[stretches.tetrahedra[worst]].mean(axis=0)
                return (
                    f"'{body.name}' is stretched {found[worst]:.2f}-fold at ({x:.1f}, {y:.1f}, {z:.1f}) mm at "
                    f"{state.time:.2f} s, and {law} holds up to {limit:g}: beyond it, forces are not those of rubber; "
                    "metrics.json has the largest stretch of the run"
                )
        return None
