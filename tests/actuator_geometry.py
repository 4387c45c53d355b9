"""The actuators of a model where its soft nodes are moved to."""

import numpy as np

from taichisoft import Model
from taichisoft.mechanics import ActuatorGeometry


def measured(model: Model, position: np.ndarray) -> ActuatorGeometry:
    """Values and gradients for these positions of the nodes [mm], shape (node_count, 3)."""
    geometry, start = ActuatorGeometry(model.actuators, model.node_count), model.initial_state()
    geometry.update(start.changed(position=position.copy()), model.placed_pull_points(start))
    return geometry
