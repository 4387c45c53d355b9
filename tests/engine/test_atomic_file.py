"""Files that appear whole, whoever else writes them at the same time."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

from taichisoft.base import atomic_file


def test_threads_that_write_one_file_at_a_time_leave_a_whole_one(tmp_path: Path) -> None:
    path, both = tmp_path / "figures.csv", Barrier(2, timeout=60)
    texts = ["one" * 1000, "two"]

    def write(text: str) -> None:
        with atomic_file(path) as partial:
            both.wait()
            partial.write_text(text)
            both.wait()

    with ThreadPoolExecutor() as threads:
        list(threads.map(write, texts))
    assert path.read_text() in texts
    assert [file.name for file in tmp_path.iterdir()] == ["figures.csv"]
