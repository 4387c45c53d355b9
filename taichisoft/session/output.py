"""What watches a run: the base class of every output."""

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # these bring Taichi
    from taichisoft.model import Model
    from taichisoft.state import State
    from taichisoft.step.report import StepReport


class Output(ABC):
    """Base class of everything that watches a run; only `record` must be written.

    An output is made as `factory(folder, **settings)` with the output folder of the run and the settings that options
    of `taichisoft run` gave. Its methods are then called in the order in which they stand here.

    Attributes:
        gives_keys: whether it puts keys into the session, so that a run without a terminal can be steered.
    """

    gives_keys: bool = False

    def begin(self, model: "Model", state: "State") -> None:
        """Prepare for a run: called once, with the state before the first step."""

    @abstractmethod
    def record(self, state: "State", report: "StepReport") -> None:
        """Take a step: called after every one. A state never changes, so it may be kept."""

    def restart(self, state: "State") -> None:
        """Take note that a user starts the run anew, from this state; the steps go on from its earlier time."""

    def end(self, outcome: str) -> None:
        """Close: called once, however the run ended.

        An error raised here is shown when every output has ended; `taichisoft.errors.GoalMissed` says that the run did
        not achieve what its scene asks for.

        Args:
            outcome: "completed", "stopped" by its user, "interrupted", or the text of the error.
        """

    def summary(self) -> dict[str, str]:
        """Rows for the table that closes a run, value by name; called last."""
        return {}
