"""What watches a run: the interface of an output."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from taichisoft.model import Model
    from taichisoft.state import State
    from taichisoft.step.report import StepReport


class Output(Protocol):
    """Made as `factory(folder, **settings)` with the run's output folder; then called in this order.

    An output may also have:

    - `restart(state)`: called when a user starts the run anew, with the state that it goes back to; without it the
      steps simply go on from an earlier time;
    - `summary() -> dict[str, str]`: rows for the table that closes a run, called last;
    - `gives_keys = True`: it puts keys into the session, so a run without a terminal can be steered.
    """

    def begin(self, model: "Model", state: "State") -> None:
        """Called once, with the state before the first step."""

    def record(self, state: "State", report: "StepReport") -> None:
        """Called after every step; a state never changes, so it may be kept."""

    def end(self, outcome: str) -> None:
        """Called once, however the run ended: "completed", "stopped" by its user, "interrupted", or the
        error's text.

        An error raised here is shown when every output has ended; `taichisoft.errors.GoalMissed` says that the
        run did not achieve what its scene asks for.
        """


class OutputFactory(Protocol):
    """What `taichisoft_outputs` maps a name to; the settings are those that options of `taichisoft run` gave."""

    def __call__(self, folder: Path, **settings: Any) -> Output: ...
