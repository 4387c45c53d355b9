"""A measured finger, as `taichisoft new measured-case` begins it, beside its simulation: a table of its curves."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.marked_page import heading, row
from taichisoft_studies.errors import StudyError
from taichisoft_studies.least_squares import (
    Calibration,
    Measurement,
    experiment_job,
    read_measurement,
    scaled_differences,
)
from taichisoft_studies.refinement import (
    MESH_ORDER,
    changed,
    finer_meshes,
    mesh_ratio,
    node_counts,
    refinement_error,
    time_order,
)
from taichisoft_studies.run_job import make_run
from taichisoft_studies.study_file import check_study, find_study, read_tables, scene_with
from taichisoft_studies.sweep_runs import fixed_overrides

CASE = "case.toml"


def case_lines(folder: Path) -> Iterator[str]:
    """The curves of a case, with its parameters at their start: what is simulated is no fit.

    Raises:
        BenchmarkError: the folder has no case.
        TaichisoftError: the case, its scene or a run is not valid.
    """
    if not (folder / CASE).is_file():
        raise BenchmarkError(f"--case {folder}: has no {CASE}; `taichisoft new measured-case` writes one")
    path = find_study(str(folder / CASE))
    study = check_study(Calibration, read_tables(path), str(path))
    values = {key: one.start for key, one in study.parameters.items()}
    scene = scene_with(study.scene, {**fixed_overrides(study), **values}, study.controller)
    changes, remark = finer_meshes(scene)
    finer_scenes = {"step": [f"time.step={scene.time.step / 2!r}"], **({"mesh": changes} if changes else {})}
    variants = {name: study.model_copy(update={"set": (*study.set, *one)}) for name, one in finer_scenes.items()}
    ratio = mesh_ratio(*node_counts(scene, changed(scene, changes))) if changes else 1.0
    yield f"\n### {folder.name}: {scene.title}\n"
    yield heading(
        ["", "rows", "off, root mean square", "error of measurement", "error by the step", "error by the mesh"]
    )
    with tempfile.TemporaryDirectory() as runs:
        for index, experiment in enumerate(study.experiments):
            file = path.parent / (experiment.data or "")
            try:
                data = read_measurement(experiment, file, f"{path}: experiments.{index}")
            except StudyError as problem:
                yield row([f"left out: {problem}", *[""] * 5])
                continue
            off = _differences(study, index, data, values, Path(runs))
            finer = {name: _differences(one, index, data, values, Path(runs)) for name, one in variants.items()}
            by_step = refinement_error(off, finer["step"], 2.0, time_order(scene))
            by_mesh = refinement_error(off, finer["mesh"], ratio, MESH_ORDER) if changes else None
            for number, curve in enumerate(experiment.curves):
                bars = [_size(one[number]) if one is not None else "not known" for one in (by_step, by_mesh)]
                scale = f"{data.scales[number]:.3g}"
                yield row([curve.column, len(data.over), _size(off[number]), scale, *bars])
    if remark:
        yield f"\nWithout error by the mesh: {remark}."


def _size(differences: np.ndarray) -> str:
    return f"{np.sqrt((differences**2).mean()):.3g}"


def _differences(
    study: Calibration, index: int, data: Measurement, values: dict[str, float], folder: Path
) -> np.ndarray:
    """Run less data, in the unit of each curve, shape (curve_count, row_count)."""
    job = experiment_job(study, index, values, folder)
    found = scaled_differences(job, make_run(job), data, study, index)
    return found.reshape(data.curves.shape) * data.scales[:, None]
