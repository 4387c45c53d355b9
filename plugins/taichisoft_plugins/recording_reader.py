"""Reading a recording: what was simulated, and where every surface was in every frame."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np

from taichisoft.mapped_surface import MappedSurface
from taichisoft_plugins.recording_layout import RecordingError


@dataclass(frozen=True)
class RecordedSurface:
    """A surface that can be drawn.

    Attributes:
        name: of the body, or of the cavity ("finger1.cavity").
        kind: what it belongs to.
        triangles: vertex indices, outward, shape (triangle_count, 3).
        vertices: gives the vertex positions [mm], shape (vertex_count, 3), in a frame.
    """

    name: str
    kind: Literal["soft", "cavity", "rigid", "obstacle"]
    triangles: np.ndarray
    vertices: Callable[[int], np.ndarray]


@dataclass(frozen=True)
class RecordedPlane:
    """An infinite plane.

    Attributes:
        name: of the obstacle.
        point: a point of it [mm], shape (3,).
        normal: unit normal [-], shape (3,).
    """

    name: str
    point: np.ndarray
    normal: np.ndarray


class Recording:
    """An open recording; steps are read when they are asked for.

    Attributes:
        path: the file.
        scene: the resolved scene as TOML text.
        outcome: how the run ended; "unfinished" while it runs and when it was killed.
        step_size: [s].
        gravity: [mm/s^2], shape (3,).
        frame_count: frames that were written whole; frame 0 is the state before the first step.
        cavities: names of the columns of `column("pressure")` and `column("volume")`.
        pairs: names of the columns of `column("normal_force")` and `column("friction_force")`.
        surfaces: everything with triangles.
        planes: the infinite obstacles.
    """

    def __init__(self, path: Path, file: Any):
        self.path = path
        self._file = file
        self._steps = file["steps"]
        self.scene: str = file.attrs["scene"]
        self.outcome: str = file.attrs["outcome"]
        self.step_size = float(file.attrs["step_size"])
        self.gravity: np.ndarray = file.attrs["gravity"]
        # A writer that was killed may have extended some datasets and not yet the others.
        self.frame_count = min(len(dataset) for dataset in self._steps.values())
        self.cavities: list[str] = list(self._steps.attrs["cavities"])
        self.pairs: list[str] = list(self._steps.attrs["pairs"])
        self.surfaces = tuple(self._surfaces())
        self.planes = tuple(
            RecordedPlane(group.attrs["name"], group.attrs["point"], group.attrs["normal"])
            for group in _numbered(file, "obstacles")
            if "point" in group.attrs
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
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

    def column(self, name: str) -> np.ndarray:
        """One quantity in all frames, shape (frame_count, ...); `recording_layout` has names and units."""
        return self._steps[name][: self.frame_count]

    def row(self, name: str, frame: int) -> np.ndarray:
        """One quantity in one frame."""
        return self._steps[name][range(self.frame_count)[frame]]

    def contacts(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Points [mm] and forces [mN] on the second body, each of shape (contact_count, 3)."""
        start = int(self.row("contact_offset", frame))
        rows = slice(start, start + int(self.row("contact_count", frame)))
        return self._file["contacts"]["point"][rows], self._file["contacts"]["force"][rows]

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

    def _surfaces(self) -> list[RecordedSurface]:
        surfaces = []
        for group in _numbered(self._file, "soft_bodies"):
            nodes = slice(*map(int, group.attrs["nodes"]))
            surfaces.append(self._soft_surface(group.attrs["name"], "soft", nodes, group["surface"]))
            for cavity in _numbered(group, "cavities"):
                surfaces.append(self._soft_surface(cavity.attrs["name"], "cavity", nodes, cavity))
        for body, group in enumerate(_numbered(self._file, "rigid_bodies")):
            surfaces.append(self._rigid_surface(group, body))
        for group in _numbered(self._file, "obstacles"):
            if "vertices" in group:
                surfaces.append(_obstacle_surface(group))
        return surfaces

    def _soft_surface(self, name: str, kind: Literal["soft", "cavity"], nodes: slice, group: Any) -> RecordedSurface:
        surface = MappedSurface(group["nodes"][:], group["weights"][:], group["triangles"][:])
        return RecordedSurface(
            name, kind, surface.triangles, lambda frame: surface.positions(self.row("position", frame)[nodes])
        )

    def _rigid_surface(self, group: Any, body: int) -> RecordedSurface:
        in_body_frame = group["vertices"][:]

        def vertices(frame: int) -> np.ndarray:
            rotation = rotation_matrix(self.row("rigid_rotation", frame)[body])
            return in_body_frame @ rotation.T + self.row("rigid_position", frame)[body]

        return RecordedSurface(group.attrs["name"], "rigid", group["triangles"][:], vertices)


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
        file = h5py.File(path, "r", libver="latest", swmr=True)
    except OSError as error:
        raise RecordingError(f"{path}: not readable as HDF5: {error}") from error
    try:
        return Recording(path, file)
    except (KeyError, ValueError, OSError) as error:
        file.close()
        raise RecordingError(f"{path}: not a recording of taichisoft: {error}") from error


def rotation_matrix(quaternion: np.ndarray) -> np.ndarray:
    """Rotation matrix, shape (3, 3), of a unit quaternion (w, x, y, z)."""
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _obstacle_surface(group: Any) -> RecordedSurface:
    vertices = group["vertices"][:]
    return RecordedSurface(group.attrs["name"], "obstacle", group["triangles"][:], lambda frame: vertices)


def _numbered(file: Any, name: str) -> list[Any]:
    """The groups "0", "1", ... of a group, in this order; HDF5 lists them as words ("10" before "2")."""
    return [file[name][key] for key in sorted(file[name], key=int)] if name in file else []
