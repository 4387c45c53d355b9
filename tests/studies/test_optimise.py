"""Optimisation: it finds a known optimum, obeys constraints, goes on where it was interrupted, and prunes."""

from pathlib import Path
from typing import Any

import pytest
from studies import PLUGIN, Here

from taichisoft import load_plugin
from taichisoft.base import text
from taichisoft.errors import PackageMissing
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft_studies.errors import StudyError
from taichisoft_studies.optimiser import (
    OWNER,
    Optimisation,
    best_trials,
    counted,
    open_study,
)
from taichisoft_studies.study_file import check_study
from taichisoft_studies.trials import (
    STRETCH,
    figures,
    make_winners,
    run_trials,
    take_over_abandoned,
    take_over_errors,
    trial_rows,
)

pytestmark = pytest.mark.usefixtures("taichisoft_plugins")

PRESSURE = "controller.settings.pressure"


class FewAtATime(Here):
    """One run at a time: what a sampler proposes then depends on nothing but its seed."""

    count = 1


def search_of(folder: Path, **tables: Any) -> Optimisation:
    """A search for the pressure, from 0 to 10 kPa, that misses 6 kPa least."""
    plugin = folder / "squeeze.py"
    plugin.write_text(PLUGIN)
    base = {
        "scene": str(TINY_GRIPPER),
        "controller": "squeeze",
        "duration": 0.01,
        "plugins": [str(plugin)],
        "set": ["limits.pressure_rate=1e6"],
        "variables": {PRESSURE: {"low": 0.0, "high": 10.0}},
        "objectives": {"miss": {"minimise": "(final_pressures_kPa['left.cavity'] - 6) ** 2"}},
        "trials": 25,
    }
    load_plugin(plugin)
    return check_study(Optimisation, {**base, **tables}, "study")


def searched(study: Optimisation, folder: Path, workers: Here | None = None) -> Any:
    """Optuna's study when all trials have been made."""
    trials = open_study(study, folder)
    trials.set_user_attr("folder", str(folder))
    run_trials(study, folder, trials, workers or FewAtATime(), lambda trial, record: None)
    return trials


@pytest.mark.parametrize("sampler", ["tpe", "cmaes", "nsga2"])
def test_search_finds_optimum_and_repeats(tmp_path: Path, sampler: str) -> None:
    study = search_of(tmp_path, sampler=sampler, trials=60 if sampler == "nsga2" else 25)
    trials = searched(study, tmp_path / "first")
    (best,) = best_trials(trials, 1)
    assert best.params[PRESSURE] == pytest.approx(6.0, abs=0.6)
    rows = trial_rows(study, trials)
    assert len(rows) == study.trials
    assert rows[best.number]["metrics.objectives.miss"] == best.value
    again = searched(study.model_copy(update={"trials": 12}), tmp_path / "second")
    assert [trial.params for trial in again.trials] == [trial.params for trial in trials.trials[:12]]


def test_best_trial_satisfies_constraints(tmp_path: Path) -> None:
    study = search_of(tmp_path, constraints={"low": "final_pressures_kPa['left.cavity'] <= 4"})
    (best,) = best_trials(searched(study, tmp_path), 1)
    assert 3.0 <= best.params[PRESSURE] <= 4.0


def test_known_design_is_tried_first(tmp_path: Path) -> None:
    trials = searched(search_of(tmp_path, start={PRESSURE: 2.5}, trials=2), tmp_path)
    assert trials.trials[0].params[PRESSURE] == 2.5 != trials.trials[1].params[PRESSURE]


def test_two_objectives_give_compromises(tmp_path: Path) -> None:
    both = {
        "high": {"maximise": "final_pressures_kPa['left.cavity']"},
        "near": {"minimise": "abs(final_pressures_kPa['left.cavity'] - 6)"},
    }
    front = best_trials(searched(search_of(tmp_path, objectives=both), tmp_path), 100)
    assert len(front) > 1
    assert min(trial.params[PRESSURE] for trial in front) > 5.0


def test_constraints_hold_across_runs(tmp_path: Path) -> None:
    """One run goes to the trial's pressure p, the other stops rising at 3 kPa, with a limit of its own.

    |p - 6| is least within "p is at most 1.5 kPa above the other run's" at 4.5 kPa, which no run alone knows.
    """
    study = search_of(
        tmp_path,
        scenes={"whole": {}, "limited": {"set": ["limits.highest_pressure=3.0"]}},
        objectives={"miss": {"minimise": "abs(whole['final_pressures_kPa']['left.cavity'] - 6)"}},
        constraints={
            "near": "whole['final_pressures_kPa']['left.cavity'] <= limited['final_pressures_kPa']['left.cavity'] + 1.5"
        },
    )
    workers = FewAtATime()
    trials = searched(study, tmp_path, workers)
    (best,) = best_trials(trials, 1)
    assert 3.5 <= best.params[PRESSURE] <= 4.5
    assert len(workers.made) == 2 * study.trials
    row = trial_rows(study, trials)[best.number]
    assert row["metrics.limited.final_pressures_kPa.left.cavity"] == 3.0
    assert row["metrics.whole.final_pressures_kPa.left.cavity"] == pytest.approx(best.params[PRESSURE], rel=1e-9)
    assert "metrics.whole.step_time_median_ms" not in row
    workers = FewAtATime()
    lines: list[str] = []
    make_winners(study, trials, tmp_path, workers, lines.append)
    assert lines[0].startswith(f"best: trial {best.number}: miss ") and "; near holds by " in lines[0]
    assert not any("finer" in line for line in lines)
    header, values = (line.split(",") for line in (tmp_path / "winners.csv").read_text().splitlines())
    assert header == ["trial", PRESSURE, "miss", "near missed by", STRETCH, "status", "folder"]
    assert float(values[3]) == pytest.approx(best.params[PRESSURE] - 4.5) and float(values[4]) > 0.0
    assert len(values[-1].split()) == 2
    finer = study.model_copy(update={"finer": ("limits.highest_pressure=2.0",)})
    make_winners(finer, trials, tmp_path, workers, lines.append)
    (line,) = (line for line in lines if "finer" in line)
    assert line == "  on the finer mesh: miss 4; near holds by 2.5"
    header = (tmp_path / "winners.csv").read_text().split(",")
    assert header[4:6] == ["miss finer", "near missed by finer"]


def test_failed_run_names_its_scene(tmp_path: Path) -> None:
    study = search_of(
        tmp_path,
        scenes={"good": {}, "bad": {"set": [f"{PRESSURE}='much'"]}},
        variables={"limits.highest_pressure": [4.0, 5.0]},
        objectives={"x": {"minimise": "good['final_pressures_kPa']['left.cavity']"}},
        trials=1,
    )
    (row,) = trial_rows(study, searched(study, tmp_path))
    assert row["status"] == "scene refused"
    assert row["message"].startswith("bad: ")


def test_failed_runs_are_failed_trials(tmp_path: Path) -> None:
    """A pressure that is text makes the controller fail; the search goes on with the others."""
    study = search_of(tmp_path, variables={PRESSURE: ["much", 5.0, 6.0]}, trials=12)
    trials = searched(study, tmp_path)
    states = {trial.params[PRESSURE]: trial.state.name for trial in trials.trials}
    assert states == {"'much'": "FAIL", "5.0": "COMPLETE", "6.0": "COMPLETE"}
    assert trial_rows(study, trials)[0]["status"] in ("completed", "controller failed")
    assert best_trials(trials, 1)[0].params[PRESSURE] == "6.0"


def test_missing_figure_is_a_failed_trial(tmp_path: Path) -> None:
    """Of the first run it is an error: an expression that is wrong is wrong for all."""
    values = {PRESSURE: [5.0, 6.0]}
    never = {"x": {"minimise": "1 / (final_pressures_kPa['left.cavity'] - 6)"}}
    study = search_of(tmp_path, variables=values, objectives=never, start={PRESSURE: 5.0}, trials=8)
    trials = searched(study, tmp_path / "later")
    states = {trial.params[PRESSURE]: trial.state.name for trial in trials.trials}
    assert states == {"5.0": "COMPLETE", "6.0": "FAIL"}
    with pytest.raises(StudyError, match=r"objectives.x.minimise = .*division by zero"):
        searched(study.model_copy(update={"start": {PRESSURE: 6.0}}), tmp_path / "first")


def test_interrupted_search_continues(tmp_path: Path) -> None:
    study = search_of(tmp_path, trials=6)
    trials = searched(study.model_copy(update={"trials": 3}), tmp_path)
    lost = trials.ask()
    pressure = lost.suggest_float(PRESSURE, 0.0, 10.0)
    host, _, _ = trials.trials[0].user_attrs[OWNER].rpartition("-")
    lost.set_user_attr(OWNER, f"{host}-{2**22 + 1}")  # larger than any process's number
    assert take_over_abandoned(trials) == 1
    workers = FewAtATime()
    trials = searched(study, tmp_path, workers)
    assert len(workers.made) == 3
    assert len(counted(trials)) == 6
    made = [trial.params[PRESSURE] for trial in trials.trials if trial.state.name == "COMPLETE"]
    assert len(made) == 6
    assert pressure in made


def test_trials_with_errors_are_repeated_once(tmp_path: Path) -> None:
    """As when a disk was full: with the same values, and without counting twice."""
    from optuna.trial import TrialState

    study = search_of(tmp_path, trials=4)
    trials = searched(study, tmp_path)
    failed = trials.ask()
    pressure = failed.suggest_float(PRESSURE, 0.0, 10.0)
    failed.set_user_attr("status", "error")
    trials.tell(failed, state=TrialState.FAIL)
    assert (take_over_errors(trials), take_over_errors(trials)) == (1, 0)
    trials = searched(study.model_copy(update={"trials": 5}), tmp_path)
    assert len(counted(trials)) == 5
    assert trials.trials[-1].params[PRESSURE] == pressure
    assert trials.trials[-1].state == TrialState.COMPLETE


def test_sessions_draw_different_values(tmp_path: Path) -> None:
    """Both are open before either asks for a trial, as on two machines."""
    study = search_of(tmp_path)
    sessions = [open_study(study, tmp_path), open_study(study, tmp_path)]
    first, second = (session.ask().suggest_float(PRESSURE, 0.0, 10.0) for session in sessions)
    assert first != second


def test_hopeless_runs_are_pruned(tmp_path: Path) -> None:
    study = search_of(tmp_path, pruning={"every": 0.01, "trials": 3}, duration=0.05, trials=15)
    trials = searched(study, tmp_path)
    states = [trial.state.name for trial in trials.trials]
    assert states[:3] == ["COMPLETE"] * 3
    assert states.count("PRUNED") > 2
    rows = trial_rows(study, trials)
    assert max(row["metrics.steps"] for row in rows if row["status"] == "pruned") < 5


def test_objectives_may_be_functions(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "def sum_of(parameters, metrics, folder):\n    return parameters['a'] + metrics['b']\n"
    )
    study = search_of(tmp_path, objectives={"x": {"maximise": f"{tmp_path / 'mine.py'}:sum_of"}})
    assert figures(study)["x"]({"parameters": {"a": 1}, "metrics": {"b": 2}}, tmp_path) == 3.0
    with pytest.raises(StudyError, match=r"objectives.x.maximise = .*mine.py:sum_of': KeyError: 'b'"):
        figures(study)["x"]({"parameters": {"a": 1}, "metrics": {}}, tmp_path)


def test_missing_torch_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(text, "find_spec", lambda name: None if name == "torch" else "there")
    with pytest.raises(PackageMissing, match=r"^sampler = 'gp': needs torch, .* not installed: pip install torch$"):
        open_study(search_of(tmp_path, sampler="gp"), tmp_path)


def test_nearest_trial_is_named() -> None:
    """Trial 1 misses one constraint by little; in units of their own, the volume's 90 mm^3 are less than 2 of force."""
    from types import SimpleNamespace

    from taichisoft_studies.optimiser import VIOLATIONS, nearest_trial
    from taichisoft_studies.trials import _nearest

    missed = ([2.0, 1000.0], [-0.5, 90.0], [4.0, -1.0])
    ended = [
        SimpleNamespace(number=number, values=[float(number)], user_attrs={VIOLATIONS: list(one)})
        for number, one in enumerate(missed)
    ]
    ended.append(SimpleNamespace(number=3, values=None, user_attrs={}))
    trials = SimpleNamespace(get_trials=lambda deepcopy: ended)
    assert nearest_trial(trials).number == 1
    study = SimpleNamespace(objectives={"work": None}, constraints={"force": "f >= 2", "silicone": "v <= 40000"})
    assert _nearest(study, trials) == (  # type: ignore[arg-type]
        "trial 1 is the nearest: work 1, and it misses silicone (v <= 40000) by 90"
    )
    assert nearest_trial(SimpleNamespace(get_trials=lambda deepcopy: [])) is None
