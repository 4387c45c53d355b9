"""The base class of every renderer, behind `Simulation.render`."""

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from taichisoft.state import State


class Renderer(ABC):
    """Base class of renderers; only `picture` must be written.

    A renderer is made as `factory(model, size, camera)` with the arguments of `Simulation.render`, and draws any states
    of that model.
    """

    @abstractmethod
    def picture(self, state: "State", marks: np.ndarray) -> np.ndarray:
        """Draw a state: red, green and blue, shape (height, width, 3), dtype uint8.

        Args:
            state: state of the model.
            marks: points that get a mark [mm], shape (mark_count, 3).
        """

    def close(self) -> None:
        """Give back what the renderer holds; called when the simulation is closed or deleted."""
