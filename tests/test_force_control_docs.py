"""All that docs/force-control.md shows to be typed works, and its figures are those that come out."""

import csv
import re
from pathlib import Path

import pytest
from test_plugin_docs import run

from taichisoft.running import plugins

DOCUMENT = (Path(__file__).resolve().parents[1] / "docs" / "force-control.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```$", DOCUMENT, re.DOTALL | re.MULTILINE)
GUARDED = 'observation.normal_forces.get(("finger", "block"), 0.0)'


def test_force_is_what_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """In the order of the page, which first has the mistake that everybody makes; forces to 1 mN."""
    monkeypatch.chdir(tmp_path)
    commands = [line for language, code in BLOCKS if language == "sh" for line in code.splitlines()]
    (program,) = (code for language, code in BLOCKS if language == "python")
    file = tmp_path / "press.py"
    file.write_text(program, encoding="utf-8")
    with plugins.separate_registry():
        for line in commands[:2]:
            run(line, monkeypatch, capfd)
        with pytest.raises(AssertionError, match=r"KeyError: \('finger', 'block'\)"):
            run(commands[2], monkeypatch, capfd)
        assert GUARDED in DOCUMENT
        file.write_text(program.replace('observation.normal_forces[("finger", "block")]', GUARDED), encoding="utf-8")
        for line in commands[2:]:
            run(line, monkeypatch, capfd)
    rows = re.findall(r"^\| [a-z ]+ \| [\d., ]+ \| (\d+) mN \| (\d+) mN \| (\d+) mN \|$", DOCUMENT, re.MULTILINE)
    for folder, shown in zip(("press", "slow", "tuned"), rows, strict=True):
        with (tmp_path / "out" / folder / "run.csv").open(encoding="utf-8", newline="") as table:
            steps = list(csv.DictReader(table))
        force = {round(float(row["time [s]"]), 6): float(row["normal_force finger|block [mN]"]) for row in steps}
        assert [force[0.4], max(force.values()), force[2.0]] == pytest.approx(list(map(float, shown)), abs=1.0)
