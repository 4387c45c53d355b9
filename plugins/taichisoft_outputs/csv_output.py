"""The output "csv": a row of figures for every step, in run.csv, for pandas or a spreadsheet."""

import csv
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from taichisoft.base import named_os_errors, warn_caller
from taichisoft.control import FIGURES, In, text_of
from taichisoft.running import Output

if TYPE_CHECKING:
    from taichisoft.contact import Model
    from taichisoft.mechanics import State
    from taichisoft.step import StepReport

FILE_NAME = "run.csv"

BUFFERED_STEPS = 50
"""Most rows that are kept in memory, which a killed run loses."""


class CsvOutput(Output):
    """Writes a row for every step, with its time at its end.

    Columns are named "figure name [unit]", in the order of `FIGURES`; the first row of names is written with the first
    step, which shows what signals the controller has.
    """

    def __init__(self, folder: Path):
        self.path = Path(folder) / FILE_NAME
        self._file: TextIO | None = None
        self._writer: Any = None
        self._row_count = self._restart_count = 0
        self._signals: list[str] = []
        self._warned: set[str] = set()

    def begin(self, model: "Model", state: "State") -> None:
        """Open the file, and take the names of the columns."""
        listed = [figure for figure in FIGURES if In.CSV in figure.recorded]
        self._figures = [(figure, figure.reader(model), figure.per.names(model)) for figure in listed]
        self._figures = [row for row in self._figures if row[2]]
        with named_os_errors(self.path):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self.path.open("w", encoding="utf-8", newline="")
        self._writer = csv.writer(self._file)

    def record(self, state: "State", report: "StepReport") -> None:
        """Write a row."""
        assert self._file is not None
        with named_os_errors(self.path):
            if self._row_count == 0:
                self._signals = list(report.signals)
                self._writer.writerow(self._columns())
            self._writer.writerow(self._row(report))
            self._row_count += 1
            if self._row_count % BUFFERED_STEPS == 0:
                self._file.flush()
        for name in report.signals.keys() - set(self._signals) - self._warned:
            self._warned.add(name)
            warn_caller(
                f"{self.path}: no column for the signal '{name}', which the controller did not have in its first step"
            )

    def restart(self, state: "State") -> None:
        """Count the restart: rows continue from an earlier time, and a column numbers the restarts."""
        self._restart_count += 1

    def end(self, outcome: str) -> None:
        """Close the file; without any step it has the names of the columns only."""
        if self._file is None:
            return
        with named_os_errors(self.path), self._file:
            if self._row_count == 0:
                self._writer.writerow(self._columns())

    def _columns(self) -> list[str]:
        columns = ["time [s]", "restarts"]
        for figure, _, names in self._figures:
            for name in names:
                parts = [figure.name, text_of(name)] if name else [figure.name]
                columns += [f"{' '.join([*parts, *axis])} [{figure.unit}]" for axis in figure.axes or [""]]
        return [*columns, *(f"signal {name}" for name in self._signals), "clipped"]

    def _row(self, report: "StepReport") -> list[str]:
        seen = report.observation.truth
        numbers: list[float] = []
        for figure, read, names in self._figures:
            values = read(seen)
            for name in names:
                value = figure.value(values, name)
                numbers += value.tolist() if figure.axes else [value]
        signals = (report.signals.get(name) for name in self._signals)
        return [
            _text(report.time),
            str(self._restart_count),
            *map(_text, numbers),
            *("" if value is None else _text(value) for value in signals),
            "|".join(seen.clipped),  # no name contains this
        ]


def _text(value: float) -> str:
    return f"{value:.9g}"
