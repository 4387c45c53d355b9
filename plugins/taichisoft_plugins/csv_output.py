"""The output "csv": what a plot needs of every step, in run.csv, for pandas or a spreadsheet."""

import csv
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np

from taichisoft.errors import TaichisoftError
from taichisoft.session.output import Output

if TYPE_CHECKING:
    from taichisoft.model import Model
    from taichisoft.state import State
    from taichisoft.step.report import StepReport

FILE_NAME = "run.csv"

BUFFERED_STEPS = 50
"""Rows between two times that the file is brought up to date: what a killed run loses at most."""

PAIR_UNITS = {"normal_force": "mN", "friction_force": "mN", "slip_speed": "mm/s"}
"""Columns of every pair of bodies; a report has them under the plural."""


class CsvOutput(Output):
    """Writes a row for every step, with its time at its end.

    Columns are named "quantity of-what [unit]"; the first row of names is written with the first step, which shows
    what signals the controller has.
    """

    def __init__(self, folder: Path):
        self.path = Path(folder) / FILE_NAME
        self._file: TextIO | None = None
        self._writer: Any = None
        self._row_count = self._restart_count = 0
        self._signals: list[str] = []
        self._warned: set[str] = set()

    def begin(self, model: "Model", state: "State") -> None:
        """Open the file, and take the names of what there is a column for.

        Raises:
            TaichisoftError: the file cannot be made.
        """
        gravity = np.array(model.scene.gravity)
        size = np.linalg.norm(gravity)
        self._up = -gravity / size if size > 0.0 else np.array([0.0, 0.0, 1.0])
        self._start = state.rigid_position.copy()
        self._cavities = [cavity.name for body in model.soft_bodies for cavity in body.cavities]
        self._objects = [body.name for body in model.rigid_bodies]
        self._pairs = pairs_with_objects(model)
        with self._errors():
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self.path.open("w", encoding="utf-8", newline="")
        self._writer = csv.writer(self._file)

    def record(self, state: "State", report: "StepReport") -> None:
        """Write a row.

        Raises:
            TaichisoftError: the disk is full, or the like.
        """
        assert self._file is not None
        with self._errors():
            if self._row_count == 0:
                self._signals = list(report.signals)
                self._writer.writerow(self._columns())
            self._writer.writerow(self._row(state, report))
            self._row_count += 1
            if self._row_count % BUFFERED_STEPS == 0:
                self._file.flush()
        for name in report.signals.keys() - set(self._signals) - self._warned:
            self._warned.add(name)
            warnings.warn(
                f"{self.path}: no column for the signal '{name}', which the controller did not have in its first step",
                stacklevel=2,
            )

    def restart(self, state: "State") -> None:
        """The rows go on from an earlier time; the column "restarts" tells them from those before."""
        self._restart_count += 1

    def end(self, outcome: str) -> None:
        """Close the file; without any step it has the names of the columns only.

        Raises:
            TaichisoftError: the disk is full, or the like.
        """
        if self._file is None:
            return
        with self._errors(), self._file:
            if self._row_count == 0:
                self._writer.writerow(self._columns())

    def _columns(self) -> list[str]:
        return [
            "time [s]",
            "restarts",
            *(f"pressure {cavity} [kPa]" for cavity in self._cavities),
            *(f"volume {cavity} [mm^3]" for cavity in self._cavities),
            *(f"base_translation {axis} [mm]" for axis in "xyz"),
            *(f"base_rotation {axis} [degrees]" for axis in "xyz"),
            *(f"position {name} {axis} [mm]" for name in self._objects for axis in "xyz"),
            *(f"lift {name} [mm]" for name in self._objects),
            *(f"{quantity} {pair} [{unit}]" for quantity, unit in PAIR_UNITS.items() for pair in self._pairs),
            *(f"signal {name}" for name in self._signals),
            "clipped",
        ]

    def _row(self, state: "State", report: "StepReport") -> list[str]:
        numbers = [
            *(report.pressures[cavity] for cavity in self._cavities),
            *(report.volumes[cavity] for cavity in self._cavities),
            *state.base_translation.tolist(),
            *np.degrees(state.base_rotation).tolist(),
            *state.rigid_position.ravel().tolist(),
            *((state.rigid_position - self._start) @ self._up).tolist(),
        ]
        for quantity in PAIR_UNITS:
            numbers += _of_pairs(getattr(report, f"{quantity}s"), self._pairs)
        signals = (report.signals.get(name) for name in self._signals)
        return [
            _text(report.time),
            str(self._restart_count),
            *map(_text, numbers),
            *("" if value is None else _text(value) for value in signals),
            "|".join(report.clipped),  # no name contains this
        ]

    @contextmanager
    def _errors(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise TaichisoftError(f"{self.path}: cannot be written: {error.strerror or error}") from error


def pairs_with_objects(model: "Model") -> list[str]:
    """All pairs of a rigid body with any other body, named as the engine names them.

    What soft bodies do to each other and to obstacles is in the recording.
    """
    soft, rigid = [body.name for body in model.soft_bodies], [body.name for body in model.rigid_bodies]
    pairs = [(body, other) for body in soft for other in rigid]
    pairs += combinations(rigid, 2)
    pairs += [(body, obstacle.name) for body in rigid for obstacle in model.obstacles]
    return ["|".join(pair) for pair in pairs]


def _of_pairs(values: Mapping[str, float], pairs: list[str]) -> list[float]:
    """In the order of `pairs`; those between which no contact was found have 0."""
    return [values.get(pair, 0.0) for pair in pairs]


def _text(value: float) -> str:
    return f"{value:.9g}"
