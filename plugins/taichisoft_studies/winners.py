"""The winners of an optimisation: run again on a finer mesh, and drawn as parts that can be made."""

import csv
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from taichisoft.atomic_file import atomic_file
from taichisoft.errors import MeshError
from taichisoft.scenes import scene_from_toml
from taichisoft_meshing.geometry_file import is_geometry, read_tables
from taichisoft_meshing.mesh_job import MeshJob
from taichisoft_meshing.mesh_process import write_mould_apart
from taichisoft_meshing.scene_meshes import merge_tables
from taichisoft_studies.errors import StudyError
from taichisoft_studies.objectives import figures
from taichisoft_studies.optimisation_file import Optimisation
from taichisoft_studies.optimiser import VIOLATIONS, best_trials, nearest_trial
from taichisoft_studies.run_folder import read_record
from taichisoft_studies.run_job import RunJob
from taichisoft_studies.sweep_runs import RUNS, make_missing
from taichisoft_studies.trial_runs import RUNS_OF_TRIAL, trial_runs
from taichisoft_studies.trials import accepted
from taichisoft_studies.workers import Workers

WINNERS = "winners.csv"


def _nearest(study: Optimisation, trials: Any) -> str:
    """The trial that misses the constraints by the least, and by how much, in words."""
    found = nearest_trial(trials)
    if found is None:
        return "results.csv says why"
    missed = zip(study.constraints.items(), found.user_attrs[VIOLATIONS], strict=True)
    by = ", ".join(f"{name} ({text}) by {value:.4g}" for (name, text), value in missed if value > 0.0)
    values = value_line(study.objectives, found.values)
    return f"trial {found.number} is the nearest: {values}, and it misses {by}"


def make_winners(
    study: Optimisation, trials: Any, output: Path, workers: Workers, say: Callable[[str], None]
) -> list[RunJob]:
    """Run the best trials again with the changes of `finer`, recorded, and write `winners.csv`.

    Args:
        study: the file.
        trials: Optuna's study, see `optimiser.open_study`.
        output: folder of the optimisation.
        workers: make the runs.
        say: called with each line about a winner.

    Returns:
        The run of each winner, of several scenes the first; the best winner first.

    Raises:
        StudyError: no trial has completed and satisfies all constraints.
    """
    best = best_trials(trials, study.winners)
    if not best:
        raise StudyError(f"{output}: no trial has completed and satisfies all constraints; {_nearest(study, trials)}")
    outputs = tuple(dict.fromkeys((*study.outputs, "recording")))
    finer = study.model_copy(update={"set": (*study.set, *study.finer), "outputs": outputs})
    winners = []
    for trial in best:
        record = read_record(output / RUNS / next(iter(trial.user_attrs[RUNS_OF_TRIAL].values())))
        assert record is not None
        winners.append(trial_runs(finer, record["parameters"], output))
    unique = {job.name: job for runs in winners for job in runs.jobs.values()}
    records = {one["run"]: one for one in make_missing(list(unique.values()), workers, lambda job, record: None)}
    wanted = figures(study)
    rows = [["trial", *study.variables, *wanted, *(f"{name} finer" for name in wanted), "status", "folder"]]
    for trial, runs in zip(best, winners, strict=True):
        runs.records.update({scene: records[job.name] for scene, job in runs.jobs.items()})
        record, first = runs.record, next(iter(runs.jobs.values()))
        again: list[Any] = [figure(record, runs.place) for figure in wanted.values()] if accepted(study, record) else []
        made = value_line(wanted, again) if again else f"{record['status']}: {record['message']}"
        say(f"best: trial {trial.number}: {value_line(wanted, trial.values)}; made again: {made}")
        for key, value in first.parameters.items():
            say(f"  {key} = {value}")
        cells = [*first.parameters.values(), *trial.values, *(again or [""] * len(wanted))]
        rows.append(
            [trial.number, *cells, record["status"], " ".join(f"{RUNS}/{one.name}" for one in runs.jobs.values())]
        )
    with atomic_file(output / WINNERS, StudyError) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows(rows)
    return [next(iter(runs.jobs.values())) for runs in winners]


def draw_winner(job: RunJob, folder: Path) -> list[str]:
    """Write the mould, or negative, of every soft body that is meshed from a geometry file, a folder for each.

    Returns:
        A line for each body: the folder of its parts, or the reason why there are none.
    """
    lines = []
    for name, body in scene_from_toml(job.scene, job.source).soft_bodies.items():
        file = Path(body.mesh.file)
        if is_geometry(body.mesh.file):
            kind, tables = read_tables(file)
            try:
                (folder / name).mkdir(parents=True, exist_ok=True)
                changed = merge_tables(tables, body.mesh.request.get("set", {}))
                write_mould_apart(MeshJob(kind, changed, file, {}), folder / name, {})
                lines.append(f"{name}: mould or negative in {folder / name}; `taichisoft mould check` checks it")
            except MeshError as error:
                lines.append(f"{name}: no mould: {error}")
    return lines


def value_line(names: Mapping[str, Any], values: Sequence[float]) -> str:
    """The objectives of a trial in one line."""
    return ", ".join(f"{name} {value:.6g}" for name, value in zip(names, values, strict=True))
