"""Comparisons and pages: what differs is found, effects are those of the data, and no text of a run becomes HTML."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from studies import Here, sweep_of
from typer.testing import CliRunner

from taichisoft_studies import taichisoft_commands
from taichisoft_studies.errors import StudyError
from taichisoft_studies.results_table import read_table, write_table
from taichisoft_studies.run_comparison import differences, draw_comparison, labels
from taichisoft_studies.study_page import best_runs, effects, figure_columns, parameter_columns, study_page
from taichisoft_studies.sweep_runs import make_missing, sweep_jobs

pytestmark = pytest.mark.usefixtures("taichisoft_plugins")


def table(count: int = 60) -> Any:
    """Runs whose force is twice the pressure, whatever the width; the last one failed."""
    generator = np.random.default_rng(1)
    pressure, width = generator.uniform(0.0, 10.0, count), generator.uniform(18.0, 22.0, count)
    rows: dict[str, Any] = {
        "run": [f"r{index}" for index in range(count)],
        "pressure": pressure,
        "width": width,
        "seed": 1,
        "status": ["completed"] * (count - 1) + ["diverged"],
        "message": [""] * (count - 1) + ["<script>alert('x')</script>"],
        "metrics.force": [*(2.0 * pressure[:-1]), np.nan],
        "metrics.steps": 10,
        "folder": "runs/x",
    }
    return pytest.importorskip("pandas").DataFrame(rows)


def test_effects_follow_the_data() -> None:
    runs = table()
    assert parameter_columns(runs) == ["pressure", "width"]
    assert figure_columns(runs, None) == ["metrics.force"]
    of_pressure, of_width = effects(runs, ["pressure", "width"], ["metrics.force"])
    assert of_pressure.correlation == pytest.approx(1.0)
    assert of_pressure.share > 0.9
    assert of_pressure.p_value < 1e-6
    assert abs(of_width.correlation) < 0.4
    assert of_width.share < 0.3
    best = best_runs(runs, "metrics.force", largest=True, count=3)
    assert best["pressure"].is_monotonic_decreasing
    assert best["pressure"].iloc[0] == runs["pressure"][:-1].max()


def test_page_shows_failures_as_text(tmp_path: Path) -> None:
    runs = table().rename(columns={"width": "a<b>&$x$"})
    page = study_page(runs, tmp_path / "<i>name")
    assert "<script>alert" not in page
    assert "&lt;script&gt;alert(&#39;x&#39;)&lt;/script&gt;" in page
    assert "<i>name" not in page
    assert "a<b>" not in page
    assert "59 completed, 1 diverged" in page
    assert page.count("<svg") == 1


def test_report_writes_the_page(tmp_path: Path) -> None:
    write_table(table().to_dict("records"), tmp_path)
    application = typer.Typer()
    taichisoft_commands(application)
    done = CliRunner().invoke(application, ["study", "report", str(tmp_path), "--metric", "force", "--smallest"])
    assert done.exit_code == 0, done.output
    assert "Best runs by force" in (tmp_path / "report.html").read_text()
    with pytest.raises(StudyError, match="--metric wieght: there are: force, steps"):
        study_page(table(), tmp_path, ["wieght"])


def test_damaged_table_is_one_line(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    write_table(table().to_dict("records"), tmp_path)
    path = tmp_path / "results.parquet"
    whole = path.read_bytes()
    pandas.testing.assert_frame_equal(read_table(tmp_path), table())
    place = whole.index(np.float64(table()["width"][7]).tobytes())
    flipped = bytes([whole[place] ^ 1])  # the last digit of a number
    for damaged in (b"", b"PAR1", whole[:-1], whole[: len(whole) // 2], whole[:place] + flipped + whole[place + 1 :]):
        path.write_bytes(damaged)
        with pytest.raises(StudyError, match=rf"^{path}: damaged \(.*\); the study's command, .* writes it") as told:
            read_table(tmp_path)
        assert "\n" not in str(told.value)
    pandas.DataFrame({"a": [1]}).to_parquet(path)
    with pytest.raises(StudyError, match=r"no table of a study, or damaged: no column 'run'"):
        read_table(tmp_path)
    path.unlink()
    with pytest.raises(StudyError, match=r"has no results.parquet; a study's folder is needed"):
        read_table(tmp_path)


def test_comparison_lists_differences(tmp_path: Path) -> None:
    study = sweep_of(tmp_path, outputs=["recording"], duration=0.05)
    jobs = sweep_jobs(study, tmp_path)
    make_missing(jobs, Here())
    folders = [job.place for job in jobs]
    found = differences(folders)
    assert found["scene.controller.settings.pressure"] == [1.0, 2.0]
    assert found["metrics.final_pressures_kPa.left.cavity"] == [1.0, 2.0]
    assert not {"scene.contact.friction", "metrics.steps", "metrics.real_time_factor"} & set(found)
    assert labels([tmp_path / "a" / "x", tmp_path / "b" / "x"]) == ["a/x", "b/x"]
    drawing = draw_comparison(folders, labels(folders), ["pressure", "height"], "svg").decode()
    assert f"{jobs[0].name}: left.cavity" in drawing
    with pytest.raises(StudyError, match="--only presure: there are: pressure, volume"):
        draw_comparison(folders, labels(folders), ["presure"], "svg")
