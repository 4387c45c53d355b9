"""The runs of a trial: one, or one of each scene of the optimisation; to objectives and tables they are one record."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from taichisoft_studies.optimisation_file import Optimisation
from taichisoft_studies.run_folder import BEYOND_LAW, COMPLETED
from taichisoft_studies.run_job import RunJob
from taichisoft_studies.sweep_runs import job_for

RUNS_OF_TRIAL = "runs"
"""What is noted at a trial: the names of its runs by scene."""


@dataclass(frozen=True)
class TrialRuns:
    """The jobs of a trial, and what has come of them so far.

    Attributes:
        jobs: by the name of the scene, which is empty where there is a single one.
        records: of the runs that have ended, likewise.
    """

    jobs: Mapping[str, RunJob]
    records: dict[str, Mapping[str, Any]] = field(default_factory=dict)

    @property
    def record(self) -> dict[str, Any]:
        """The record of the trial, when all its runs have ended."""
        return joined({scene: self.records[scene] for scene in self.jobs})

    @property
    def place(self) -> Path | dict[str, Path]:
        """The folder of the run, or of each run by the name of its scene."""
        places = {scene: job.place for scene, job in self.jobs.items()}
        return places.get("", places)


def trial_runs(study: Optimisation, parameters: Mapping[str, Any], folder: Path, **others: Any) -> TrialRuns:
    """The runs of a trial with these values; the arguments as for `sweep_runs.job_for`.

    Raises:
        SceneError, StudyError: a key or value is not valid; it is named.
    """
    by_scene = study.by_scene().items()
    return TrialRuns({scene: job_for(one, parameters, folder, study.seed, **others) for scene, one in by_scene})


def joined(records: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """One record of the records by scene: the metrics by scene, and the status of the run that went worst."""
    if "" in records:
        return dict(records[""])
    ranks = {COMPLETED: 2, BEYOND_LAW: 1}
    scene, worst = min(records.items(), key=lambda item: ranks.get(item[1]["status"], 0))
    return {
        "run": "+".join(record["run"] for record in records.values()),
        "parameters": worst["parameters"],
        "seed": worst["seed"],
        "status": worst["status"],
        "message": f"{scene}: {worst['message']}" if worst["message"] else "",
        "metrics": {scene: record["metrics"] for scene, record in records.items()},
    }
