"""The output "recording": everything that a run computed, in one HDF5 file that survives a killed run."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import taichisoft
from taichisoft_plugins.recording_layout import (
    CONTACT_UNITS,
    FILE_NAME,
    REPORT_UNITS,
    STATE_UNITS,
    RecordingError,
    cavity_names,
    pair_names,
    report_row,
    state_row,
    write_bodies,
)

if TYPE_CHECKING:
    from taichisoft.model import Model
    from taichisoft.simulation import StepReport
    from taichisoft.state import State

BUFFERED_STEPS = 50
"""Steps kept in memory between two writes: what a killed run loses at most."""

FRAMES_PER_CHUNK = 10
"""A chunk is packed and read as a whole: long ones are smaller, short ones give a single frame sooner."""

# Three times as fast as gzip 1 and 8 % larger, measured on the nodes of a bending finger.
PACKING = {"compression": "lzf", "shuffle": True}


class RecordingOutput:
    """Writes `recording.h5` into the run's folder; `recording_layout` says what is in it.

    Steps are written in bundles, in HDF5's single-writer-multiple-reader mode: a process that is killed
    leaves a file that opens, with every step up to its last bundle.
    """

    def __init__(self, folder: Path):
        self.path = Path(folder) / FILE_NAME
        self._file: Any = None
        self._rows: list[dict[str, np.ndarray]] = []
        self._contacts: dict[str, list[np.ndarray]] = {name: [] for name in CONTACT_UNITS}
        self._contact_total = 0

    def begin(self, model: "Model", state: "State") -> None:
        """Write scene and bodies; the state before the first step becomes frame 0.

        Raises:
            RecordingError: the file cannot be made.
        """
        import h5py

        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = h5py.File(self.path, "w", libver="latest")
        except OSError as error:
            raise RecordingError(f"{self.path}: cannot be written: {error}") from error
        self._write_header(model)
        write_bodies(self._file, model)
        self._cavities, self._pairs = cavity_names(model), pair_names(model)
        self._buffer(state, None)
        self._create_datasets(self._rows[0])
        # From here on rows can be added, but no group, dataset or attribute.
        self._file.swmr_mode = True
        self._flush()

    def record(self, state: "State", report: "StepReport") -> None:
        """Keep the step, and write the bundle when it is full."""
        self._buffer(state, report)
        if len(self._rows) >= BUFFERED_STEPS:
            self._flush()

    def restart(self, state: "State") -> None:
        """The frames go on with the first state again; what came before stays."""
        self._buffer(state, None)

    def end(self, outcome: str) -> None:
        """Write what is still in memory and how the run ended; the file is closed whatever happens."""
        import h5py

        if self._file is None:
            return
        try:
            self._flush()
        finally:
            self._file.close()
            self._file = None
        with h5py.File(self.path, "r+", libver="latest") as file:
            file.attrs["outcome"] = outcome

    def _write_header(self, model: "Model") -> None:
        from taichisoft.scene_file import scene_to_toml

        attributes = self._file.attrs
        attributes["taichisoft_version"] = taichisoft.__version__
        attributes["scene"] = scene_to_toml(model.scene)
        attributes["gravity"] = np.array(model.scene.gravity, dtype=np.float64)
        attributes["step_size"] = float(model.scene.time.step)
        attributes["outcome"] = "unfinished"

    def _create_datasets(self, row: dict[str, np.ndarray]) -> None:
        import h5py

        steps = self._file.create_group("steps")
        steps.attrs.create("cavities", self._cavities, (len(self._cavities),), h5py.string_dtype())
        steps.attrs.create("pairs", self._pairs, (len(self._pairs),), h5py.string_dtype())
        for name, unit in {**STATE_UNITS, **REPORT_UNITS}.items():
            value = row[name]
            frames = FRAMES_PER_CHUNK if value.size > 100 else BUFFERED_STEPS
            self._create_rows(steps, name, unit, value.shape, value.dtype, frames)
        contacts = self._file.create_group("contacts")
        for name, unit in CONTACT_UNITS.items():
            self._create_rows(contacts, name, unit, (3,), np.dtype(np.float64), 512)

    @staticmethod
    def _create_rows(
        group: Any, name: str, unit: str, shape: tuple[int, ...], dtype: np.dtype, chunk_rows: int
    ) -> None:
        chunks = (chunk_rows, *(max(length, 1) for length in shape))
        maximum = (None, *(length or None for length in shape))  # a chunk may not exceed the maximum
        dataset = group.create_dataset(name, (0, *shape), maxshape=maximum, chunks=chunks, dtype=dtype, **PACKING)
        dataset.attrs["unit"] = unit

    def _buffer(self, state: "State", report: "StepReport | None") -> None:
        numbers = report_row(report, self._contact_total, self._cavities, self._pairs)
        self._rows.append({**state_row(state), **numbers})
        if report is not None:
            self._contacts["point"].append(np.array(report.contact_points))
            self._contacts["force"].append(np.array(report.contact_forces))
            self._contact_total += len(report.contact_points)

    def _flush(self) -> None:
        if not self._rows:
            return
        for name, parts in self._contacts.items():
            _extend(self._file["contacts"][name], np.concatenate([np.empty((0, 3)), *parts]))
            parts.clear()
        for name in self._rows[0]:
            _extend(self._file["steps"][name], np.stack([row[name] for row in self._rows]))
        self._rows.clear()
        self._file.flush()


def _extend(dataset: Any, rows: np.ndarray) -> None:
    count = len(dataset)
    dataset.resize(count + len(rows), axis=0)
    dataset[count:] = rows
