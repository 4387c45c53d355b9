"""Base class of outputs, which record a run."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # these import Taichi
    from taichisoft.model import Model
    from taichisoft.state import State
    from taichisoft.step.report import StepReport


class Output(ABC):
    """Base class of outputs; only `record` is abstract.

    An output is made as `factory(folder, **settings)`, with the output folder of the run and settings from options of
    `taichisoft run`. Its methods are then called in the order of their definition.

    Attributes:
        gives_keys: whether the output puts keys into the session, to steer a run without a terminal.
        save_controller: function that returns as JSON what the controller of the run remembers now, see
            `Controller.save`; empty for a controller that does not save. The run sets it before `begin`.
    """

    gives_keys: bool = False
    save_controller: Callable[[], str] = staticmethod(lambda: "")

    def begin(self, model: "Model", state: "State") -> None:
        """Begin a run; called once, with the state before the first step."""

    @abstractmethod
    def record(self, state: "State", report: "StepReport") -> None:
        """Record a step; called after every step. A state never changes, so it may be kept."""

    def restart(self, state: "State") -> None:
        """Note that the user restarts the run from this state, at its earlier time."""

    def end(self, outcome: str) -> None:
        """End the run; called once, however the run ended.

        An error raised here is shown after every output has ended; `taichisoft.errors.GoalMissed` means that the run
        missed the goal of its scene.

        Args:
            outcome: "completed", "stopped" by its user, "interrupted", or the text of the error.
        """

    def summary(self) -> dict[str, str]:
        """Rows of the closing table of a run, value by name; called last."""
        return {}
