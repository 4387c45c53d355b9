"""One flipped bit in a file of modes, of a kept run or of a state: it is refused in one line, or changes nothing."""

import random
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import taichisoft
from taichisoft import State
from taichisoft.errors import TaichisoftError
from taichisoft.mechanics import Modes
from taichisoft.mechanics.modes import read_modes
from taichisoft_reduction.training_run import RunResult

TRIES = 400
NUMBERS = np.random.default_rng(1).normal(size=(5, 3, 2))
MODES = Modes(NUMBERS[:, :, 0], NUMBERS, np.arange(5), np.ones(5), np.ones((2, 2)), "x", 0.1, 0.1, 0.1, 0.1)
RUN = RunResult("a", "", np.arange(2.0), {"b": NUMBERS.T}, {"lift": np.arange(2.0)}, {"b": np.zeros(5, bool)}, {}, 1.0)


def values(read: Any) -> list[tuple[str, bytes]]:
    """All that a data class has, as bytes."""
    found = []
    for name, value in vars(read).items():
        for key, one in value.items() if isinstance(value, dict) else [("", value)]:
            found.append((name + key, np.asarray(one).tobytes()))
    return found


@pytest.mark.parametrize(
    ("write", "read"),
    [
        (MODES.write, lambda path: read_modes(path, "soft_bodies.finger.reduced")),
        (RUN.save, RunResult.load),
        (lambda path: tiny_state().save(path), State.load),
    ],
    ids=["modes", "run", "state"],
)
def test_flipped_bit_is_refused(tmp_path: Path, write: Callable[[Path], None], read: Callable[[Path], Any]) -> None:
    """Bits of the headers and of the directory of the zip file, and some of its arrays, drawn with a fixed seed."""
    path, draw = tmp_path / "file.npz", random.Random(3)
    write(path)
    content, right = path.read_bytes(), values(read(path))
    starts = [place for place in range(len(content)) if content.startswith(b"PK", place)]
    places = {place for start in starts for place in range(start, min(start + 60, len(content)))}
    flips = [(place, bit) for place in sorted(places) for bit in range(8)]
    flips = draw.sample(flips, min(TRIES, len(flips)))
    flips += [(draw.randrange(len(content)), draw.randrange(8)) for _ in range(TRIES // 4)]
    refused = 0
    for place, bit in flips:
        flipped = bytearray(content)
        flipped[place] ^= 1 << bit
        path.write_bytes(flipped)
        try:
            got = read(path)
        except TaichisoftError as error:
            assert len(str(error).splitlines()) == 1
            got = None
        refused += got is None
        assert got is None or values(got) == right, (place, bit)
    assert refused > len(flips) // 3


def test_two_arrays_of_one_name_are_refused(tmp_path: Path) -> None:
    MODES.write(tmp_path / "file.npz")
    with zipfile.ZipFile(tmp_path / "file.npz", "a") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        archive.writestr("modes.npy", archive.read("modes.npy"))
    with pytest.raises(TaichisoftError, match="two of its arrays have one name"):
        read_modes(tmp_path / "file.npz", "soft_bodies.finger.reduced")


def tiny_state() -> State:
    """The state of the tiny gripper before its first step."""
    folder = Path(taichisoft.__file__).parent / "tiny_gripper"
    return taichisoft.Simulation(taichisoft.load_scene(str(folder / "scene.toml"))).state
