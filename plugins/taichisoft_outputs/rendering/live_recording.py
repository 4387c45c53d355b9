"""A state of a running simulation in the place of a recording, for what draws recordings."""

import numpy as np

from taichisoft.actuators import Actuators
from taichisoft.state import State
from taichisoft_outputs.recording.layout import QUANTITIES, group_of
from taichisoft_outputs.recording.reader import Recording


class LiveRecording(Recording):
    """The recording of a single frame whose quantities are replaced by one state after the other."""

    def show(self, values: dict[str, np.ndarray]) -> None:
        """Take over a state: its fields by the paths of `layout.QUANTITIES`, in `steps` as a row of one frame."""
        self._values = values

    def _rows(self, path: str, first: int, end: int) -> np.ndarray:
        return self._values[path]


def live_values(state: State, actuators: Actuators) -> dict[str, np.ndarray]:
    """What `LiveRecording.show` takes, of a state of the model with these actuators."""
    values = {"steps/state_count": np.zeros(1, dtype=int)}
    for path, quantity in QUANTITIES.items():
        if quantity.state_field and group_of(path) in ("steps", "contacts"):
            value = np.asarray(quantity.of(state, actuators))
            values[path] = value if group_of(path) == "contacts" else value[None]
    return values
