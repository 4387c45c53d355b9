"""A short version of `python -m taichisoft_benchmarks.faults`: damage is told of, and no wrong number is read."""

from pathlib import Path

import pytest

from taichisoft_benchmarks.faults.edges import EDGES
from taichisoft_benchmarks.faults.recordings import DAMAGES, damaged, readable, record, tiny_run


def test_damaged_recordings_are_told_of(tmp_path: Path) -> None:
    run = tiny_run(3)
    record(run, tmp_path)
    assert readable(tmp_path / "recording.h5")
    failed, told, _ = damaged(run, tmp_path, 3 * len(DAMAGES))
    assert failed == 0 and told > 0


@pytest.mark.parametrize("row", EDGES)
def test_a_row_of_tries_has_no_failures(row: str) -> None:
    _, attempt = EDGES[row]
    assert attempt(2) == []
