"""Reading a recording: what was simulated, and what was in every frame."""

import json
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np

from taichisoft.state import State
from taichisoft_plugins.recording.layout import (
    CONTACT_QUANTITIES,
    FIELDS,
    LAYOUT,
    OPENED,
    STEP_QUANTITIES,
    RecordingError,
)
from taichisoft_plugins.recording.recorded_bodies import (
    RecordedPlane,
    RecordedRigidBody,
    RecordedSoftBody,
    RecordedSurface,
    numbered,
    read_rigid_body,
    read_soft_body,
)
from taichisoft_plugins.recording.recorded_surfaces import read_planes, read_surfaces

__all__ = ["RecordedPlane", "RecordedRigidBody", "RecordedSoftBody", "RecordedSurface", "Recording", "read_recording"]


class Recording:
    """An open recording; steps are read when they are asked for.

    Attributes:
        path: the file.
        scene: the resolved scene as TOML text.
        versions: of taichisoft and what it computed with, by name.
        outcome: how the run ended; "unfinished" while it runs and when it was killed.
        step_size: [s].
        every: steps from frame to frame.
        fields: what was recorded, see `layout.FIELDS`.
        gravity: [mm/s^2], shape (3,).
        frame_count: frames that were written whole; frame 0 is the state before the first step.
        cavities: names of the columns of `column("pressure")` and `column("volume")`.
        pairs: names of the columns of `column("normal_force")`, `column("friction_force")` and `column("slip_speed")`.
        surfaces: everything with triangles.
        planes: the infinite obstacles.
    """

    def __init__(self, path: Path, file: Any):
        self.path = path
        self._file = file
        self._steps = file["steps"]
        attributes = file.attrs
        self.scene: str = attributes["scene"]
        self.versions: dict[str, str] = json.loads(attributes.get("versions", "{}"))
        self.outcome: str = attributes["outcome"]
        self.step_size = float(attributes["step_size"])
        self.every = int(attributes.get("every", 1))
        self.fields: tuple[str, ...] = tuple(attributes.get("fields", FIELDS))
        self.gravity: np.ndarray = attributes["gravity"]
        self.frame_count = self._count_frames()
        self.cavities: list[str] = list(self._steps.attrs["cavities"])
        self.pairs: list[str] = list(self._steps.attrs["pairs"])
        self.surfaces = tuple(read_surfaces(file, self.row))
        self.planes = tuple(read_planes(file))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file, as the end of a `with` statement does."""
        self._file.close()

    @property
    def times(self) -> np.ndarray:
        """Time of every frame [s], shape (frame_count,)."""
        return self.column("time")

    @property
    def up(self) -> np.ndarray:
        """Unit vector against gravity, shape (3,); z where there is no gravity."""
        strength = np.linalg.norm(self.gravity)
        return -self.gravity / strength if strength > 0 else np.array([0.0, 0.0, 1.0])

    @cached_property
    def soft_bodies(self) -> tuple[RecordedSoftBody, ...]:
        """Meshes and materials.

        Raises:
            RecordingError: an older version wrote the file, without them.
        """
        try:
            return tuple(map(read_soft_body, numbered(self._file, "soft_bodies")))
        except KeyError as error:
            raise self._lacks("meshes and materials of the soft bodies", None) from error

    @cached_property
    def rigid_bodies(self) -> tuple[RecordedRigidBody, ...]:
        """Surfaces in the body frames."""
        return tuple(map(read_rigid_body, numbered(self._file, "rigid_bodies")))

    def has(self, name: str) -> bool:
        """Whether a quantity was recorded; `recording_layout` has names and units."""
        return name in self._steps

    def column(self, name: str) -> np.ndarray:
        """One quantity in all frames, shape (frame_count, ...).

        Raises:
            RecordingError: it was not recorded.
        """
        return self._dataset("steps", name)[: self.frame_count]

    def row(self, name: str, frame: int) -> np.ndarray:
        """One quantity in one frame.

        Raises:
            RecordingError: it was not recorded.
        """
        return self._dataset("steps", name)[range(self.frame_count)[frame]]

    def contacts(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Points [mm] and forces [mN] on the second body, each of shape (contact_count, 3).

        Raises:
            RecordingError: they were not recorded.
        """
        return self._contact_rows("point", frame), self._contact_rows("impulse", frame) / self.step_size

    def state(self, frame: int) -> State:
        """The state in a frame, bit for bit: a run that goes on from it is the one that was recorded.

        Raises:
            RecordingError: something of it was not recorded.
        """
        needed = {
            quantity.field
            for quantity in (*STEP_QUANTITIES.values(), *CONTACT_QUANTITIES.values())
            if quantity.of_state
        }
        missing = [field for field in FIELDS if field in needed and field not in self.fields]
        if missing:
            raise RecordingError(
                f"{self.path}: has no whole state: --fields {','.join(self.fields)} left out {', '.join(missing)}"
            )
        values: dict[str, Any] = {}
        for name, quantity in STEP_QUANTITIES.items():
            if quantity.of_state:
                values[quantity.of_state] = self.row(name, frame)
        for name, quantity in CONTACT_QUANTITIES.items():
            values[quantity.of_state] = self._contact_rows(name, frame)
        return State(**{**values, "time": float(values["time"]), "step": int(values["step"])})

    @property
    def last_start(self) -> int:
        """The frame with the first state of the last start: a user may have started the run anew."""
        return int(np.max(np.flatnonzero(np.diff(self.times) < 0.0) + 1, initial=0))

    def frame_at(self, time: float) -> int:
        """Index of the frame nearest to `time` [s] since the last start.

        Raises:
            RecordingError: it was not recorded.
        """
        first = self.last_start
        times = self.times[first:]
        if not len(times) or not times[0] - self.step_size <= time <= times[-1] + self.step_size:
            reach = f"from {times[0]:g} s to {times[-1]:g} s" if len(times) else "no frame"
            raise RecordingError(f"{self.path}: nothing at {time:g} s; the recording has {reach}")
        return first + int(np.argmin(np.abs(times - time)))

    def refresh(self) -> None:
        """See the frames that a run in progress has written since the file was opened, or since the last call."""
        self._file["frames"].refresh()
        frame_count = self._count_frames()  # before the others, which may go on growing
        for dataset in (*self._steps.values(), *self._file["contacts"].values()):
            dataset.refresh()
        self.frame_count = frame_count

    def _count_frames(self) -> int:
        if "frames" in self._file:
            return int(self._file["frames"][0])
        # Of an older version; if it was killed, some datasets are longer than others.
        return min(len(dataset) for dataset in self._steps.values())

    def _contact_rows(self, name: str, frame: int) -> np.ndarray:
        start = int(self.row("contact_offset", frame))
        return self._dataset("contacts", name)[start : start + int(self.row("contact_count", frame))]

    def _dataset(self, group: str, name: str) -> Any:
        if name in self._file[group]:
            return self._file[group][name]
        quantities = STEP_QUANTITIES if group == "steps" else CONTACT_QUANTITIES
        if name not in quantities:
            raise RecordingError(f"{self.path}: {group} have no '{name}'; there are: {', '.join(self._file[group])}")
        raise self._lacks(f"{group}/{name}", quantities[name].field)

    def _lacks(self, what: str, field: str | None) -> RecordingError:
        if field is not None and field not in self.fields:
            why = f"--fields {','.join(self.fields)} left it out; record it with '{field}'"
        else:
            version = self._file.attrs["taichisoft_version"]
            layout = self._file.attrs.get("layout", 1)
            why = f"taichisoft {version} wrote it in layout {layout}, this version reads {LAYOUT}; run the scene again"
        return RecordingError(f"{self.path}: has no {what}: {why}")


def read_recording(path: str | Path) -> Recording:
    """Open a recording; use it in a `with` statement. That of a killed or running simulation opens too.

    Raises:
        RecordingError: the file is missing or is no recording.
    """
    import h5py

    path = Path(path)
    if not path.is_file():
        raise RecordingError(f"{path}: no such recording; `taichisoft run` writes one into its output folder")
    try:
        file = h5py.File(path, "r", swmr=True, **OPENED)
    except OSError as error:
        raise RecordingError(f"{path}: not readable as HDF5: {error}") from error
    try:
        return Recording(path, file)
    except (KeyError, ValueError, OSError) as error:
        file.close()
        raise RecordingError(f"{path}: not a recording of taichisoft: {error}") from error
