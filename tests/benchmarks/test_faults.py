"""Faults of many kinds at random: damage is reported, and no wrong number is read."""

import pytest

from taichisoft_benchmarks.faults import damaged_files, driving, mechanics, ports, sofa_scenes
from taichisoft_benchmarks.faults.damage import DAMAGES

ROWS = {name: row for module in (ports, driving, mechanics, sofa_scenes) for name, row in module.ROWS.items()}


def test_damaged_recordings_are_refused_or_read_as_written() -> None:
    assert damaged_files.damaged_recordings(3 * len(DAMAGES), steps=3) == []


def test_a_recording_that_is_never_refused_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(damaged_files, "DAMAGES", (lambda content, dice: content,))
    assert damaged_files.damaged_recordings(2, steps=3) == ["none of 2 damages is reported"]


def test_reports_of_damaged_tables_end_well() -> None:
    assert damaged_files.damaged_tables(2) == []


@pytest.mark.parametrize("row", ROWS)
def test_a_row_of_tries_has_no_failures(row: str) -> None:
    _, attempt = ROWS[row]
    assert attempt(2) == []
