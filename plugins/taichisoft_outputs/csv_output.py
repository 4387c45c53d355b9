"""The output "csv": a row of figures for every step, in run.csv, for pandas or a spreadsheet."""

import csv
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np

from taichisoft.base import named_os_errors, warn_caller
from taichisoft.mechanics import ACTUATOR_KINDS
from taichisoft.running import Output

if TYPE_CHECKING:
    from taichisoft.contact import Model
    from taichisoft.control import Pair
    from taichisoft.mechanics import State
    from taichisoft.step import StepReport

FILE_NAME = "run.csv"

BUFFERED_STEPS = 50
"""Most rows that are kept in memory, which a killed run loses."""

PAIR_UNITS = {
    "normal_force": "mN",
    "friction_force": "mN",
    "slip_speed": "mm/s",
    "contact_area": "mm^2",
    "contact_area_error": "mm^2",
    "peak_pressure": "kPa",
    "peak_pressure_error": "kPa",
}
"""Columns of every pair of bodies; a report has them under the plural."""


WRENCH_UNITS = {
    "base_force": "mN",
    "base_torque": "mN mm",
    "base_force_in_base": "mN",
    "base_torque_in_base": "mN mm",
}
"""Units of the fields of an observation with the wrench on the base."""
FRAME_UNITS = {
    "frame_translations": "mm",
    "frame_rotations": "degrees",
    "frame_forces": "mN",
    "frame_torques": "mN mm",
}
"""Units of those of other frames, by name."""


class CsvOutput(Output):
    """Writes a row for every step, with its time at its end.

    Columns are named "quantity name [unit]"; the first row of names is written with the first step, which shows
    which fingers have tips, and what signals the controller has.
    """

    def __init__(self, folder: Path):
        self.path = Path(folder) / FILE_NAME
        self._file: TextIO | None = None
        self._writer: Any = None
        self._row_count = self._restart_count = 0
        self._signals: list[str] = []
        self._fingers: list[str] = []
        self._warned: set[str] = set()

    def begin(self, model: "Model", state: "State") -> None:
        """Open the file, and take the names of the columns.

        Raises:
            TaichisoftError: the file cannot be made.
        """
        self._up = model.scene.up
        # A run that is resumed counts on from where the scene has the bodies.
        self._start = np.array([body.start_position for body in model.rigid_bodies]).reshape(-1, 3)
        self._figures = [
            (figure, name)
            for kind in ACTUATOR_KINDS
            for figure in kind.measured
            if figure.recorded
            for name in model.actuators.names_of(kind)
        ]
        self._objects = model.scene.objects
        self._rows_of_objects = [list(model.scene.rigid_bodies).index(name) for name in self._objects]
        self._frames = list(model.scene.frames)
        self._pairs = pairs_with_objects(model)
        with named_os_errors(self.path):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self.path.open("w", encoding="utf-8", newline="")
        self._writer = csv.writer(self._file)

    def record(self, state: "State", report: "StepReport") -> None:
        """Write a row.

        Raises:
            TaichisoftError: the disk is full, or the like.
        """
        assert self._file is not None
        with named_os_errors(self.path):
            if self._row_count == 0:
                self._signals, self._fingers = list(report.signals), list(report.observation.truth.tip_positions)
                self._writer.writerow(self._columns())
            self._writer.writerow(self._row(state, report))
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
        """Close the file; without any step it has the names of the columns only.

        Raises:
            TaichisoftError: the disk is full, or the like.
        """
        if self._file is None:
            return
        with named_os_errors(self.path), self._file:
            if self._row_count == 0:
                self._writer.writerow(self._columns())

    def _columns(self) -> list[str]:
        return [
            "time [s]",
            "restarts",
            *(f"{figure.name} {name} [{figure.unit}]" for figure, name in self._figures),
            *(f"tip_position {name} {axis} [mm]" for name in self._fingers for axis in "xyz"),
            *(f"bending_angle {name} [degrees]" for name in self._fingers),
            *(f"base_translation {axis} [mm]" for axis in "xyz"),
            *(f"base_rotation {axis} [degrees]" for axis in "xyz"),
            *(f"{field} {axis} [{unit}]" for field, unit in WRENCH_UNITS.items() for axis in "xyz"),
            *(
                f"{field[:-1]} {name} {axis} [{unit}]"
                for field, unit in FRAME_UNITS.items()
                for name in self._frames
                for axis in "xyz"
            ),
            *(f"position {name} {axis} [mm]" for name in self._objects for axis in "xyz"),
            *(f"lift {name} [mm]" for name in self._objects),
            *(f"{quantity} {'|'.join(pair)} [{unit}]" for quantity, unit in PAIR_UNITS.items() for pair in self._pairs),
            *(f"signal {name}" for name in self._signals),
            "clipped",
        ]

    def _row(self, state: "State", report: "StepReport") -> list[str]:
        seen = report.observation.truth
        numbers = [
            *(getattr(seen, figure.observed)[name] for figure, name in self._figures),
            *(component for name in self._fingers for component in seen.tip_positions[name].tolist()),
            *(float(np.degrees(seen.bending_angles[name])) for name in self._fingers),
            *state.base_translation.tolist(),
            *np.degrees(state.base_rotation).tolist(),
            *(component for field in WRENCH_UNITS for component in getattr(seen, field).tolist()),
            *(
                component
                for field, unit in FRAME_UNITS.items()
                for name in self._frames
                for component in _in_unit(getattr(seen, field)[name], unit).tolist()
            ),
            *state.rigid_position[self._rows_of_objects].ravel().tolist(),
            *((state.rigid_position - self._start) @ self._up)[self._rows_of_objects].tolist(),
        ]
        for quantity in PAIR_UNITS:
            values = getattr(seen, f"{quantity}s")  # pairs between which no contact was found are missing
            numbers += [values.get(pair, 0.0) for pair in self._pairs]
        signals = (report.signals.get(name) for name in self._signals)
        return [
            _text(report.time),
            str(self._restart_count),
            *map(_text, numbers),
            *("" if value is None else _text(value) for value in signals),
            "|".join(seen.clipped),  # no name contains this
        ]


def pairs_with_objects(model: "Model") -> list["Pair"]:
    """All pairs of a rigid body with any other body that it can touch, in the order of the scene.

    Where there is none: of soft bodies with obstacles, which they then press. The recording has all others.
    """
    rigid = [body for body in model.rigid_bodies if body.collides or body.follows is None]
    pairs: list[Pair] = [(body.name, other.name) for body in model.soft_bodies for other in rigid]
    pairs += [(one.name, two.name) for one, two in combinations(rigid, 2) if None in (one.follows, two.follows)]
    pairs += [(body.name, one.name) for body in rigid if body.follows is None for one in model.obstacles]
    return pairs if rigid else [(body.name, one.name) for body in model.soft_bodies for one in model.obstacles]


def _in_unit(values: np.ndarray, unit: str) -> np.ndarray:
    return np.degrees(values) if unit == "degrees" else values


def _text(value: float) -> str:
    return f"{value:.9g}"
