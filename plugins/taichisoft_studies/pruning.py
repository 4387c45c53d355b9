"""Pruning: a run that an optimiser watches ends early when it cannot become one of the better ones."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from taichisoft.errors import ControllerFailed
from taichisoft.session import Output
from taichisoft_studies.study_expressions import Expression

if TYPE_CHECKING:
    from taichisoft.model import Model
    from taichisoft.state import State
    from taichisoft.step import StepReport
    from taichisoft_outputs.metrics import MetricsOutput


class Pruned(ControllerFailed):
    """A run was ended because others were better at the same simulated time."""


class PruningOutput(Output):
    """Reports the objective to the optimiser periodically, and ends the run when it is pruned."""

    def __init__(self, metrics: "MetricsOutput", parameters: Mapping[str, Any], settings: Mapping[str, Any]):
        """Prepare.

        Args:
            metrics: figures of the same run; it is asked after every step.
            parameters: values of the run by key.
            settings: "journal", file of the optimiser's storage, and "trial", its identity there;
                "objective", text of the expression; "every" [s], "warm_up" [s] and "trials", before which nothing is
                pruned.
        """
        self._metrics, self._parameters, self._settings = metrics, parameters, settings
        self._objective = Expression(settings["objective"], "objectives")
        self._period = 1

    def begin(self, model: "Model", state: "State") -> None:
        """Find the trial."""
        from taichisoft_studies.optimiser import open_trial

        self._trial = open_trial(self._settings)
        self._period = max(1, round(self._settings["every"] / model.scene.time.step))
        self._count = 0

    def record(self, state: "State", report: "StepReport") -> None:
        """Report the objective at every period.

        Raises:
            Pruned: the run cannot become one of the better ones.
        """
        self._count += 1
        if self._count % self._period or report.time < self._settings["warm_up"]:
            return
        value = self._objective({**self._metrics.figures("running"), "parameters": self._parameters})
        self._trial.report(value, step=self._count)
        if self._trial.should_prune():
            raise Pruned(f"{self._objective.text} = {value:.6g} at {report.time:g} s: others were better by then")
