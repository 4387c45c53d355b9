"""The colours that a scene gives its bodies."""

import numpy as np

from taichisoft.scenes.colours import red_green_blue
from taichisoft.scenes.scene import Scene


def body_colours(scene: Scene) -> dict[str, np.ndarray]:
    """Red, green and blue [-], shape (3,), by body or obstacle, of those that have a colour of their own."""
    chosen: dict[str, str | None] = {}
    for bodies in (scene.soft_bodies, scene.rigid_bodies, scene.obstacles):
        chosen |= {name: body.colour for name, body in bodies.items()}
    return {name: np.array(red_green_blue(colour)) for name, colour in chosen.items() if colour is not None}
