"""Reading a recording: what was simulated, and what was in every frame."""

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np

from taichisoft.bodies.body_axes import BodyAxes, axes_of_bodies
from taichisoft.bodies.cable_paths import CablePath, segment_tensions
from taichisoft.bodies.surfaces import BodySurface
from taichisoft.control.observation import Pair
from taichisoft.meshes.surface import MappedSurface
from taichisoft.scenes.file import scene_from_toml
from taichisoft.scenes.scene import Scene
from taichisoft.state import State
from taichisoft_plugins.recording.bodies import (
    RecordedSoftBody,
    RecordedSurface,
    read_cables,
    read_planes,
    read_soft_bodies,
    read_surfaces,
)
from taichisoft_plugins.recording.checksums import CHECKSUMS, COLUMN, checksum, checksums
from taichisoft_plugins.recording.content import PATIENCE, Content, DamagedContent
from taichisoft_plugins.recording.layout import QUANTITIES, SIGNAL_NAMES, RecordingError
from taichisoft_plugins.recording.texts import decoded, read_text, read_texts


class Recording:
    """An open recording; steps are read when they are asked for, and what is damaged is an error.

    Attributes:
        path: the file.
        scene_text: the resolved scene as TOML.
        versions: versions of taichisoft and of what it computed with, by name.
        outcome: how the run ended; "unfinished" while it runs and when it was killed.
        step_size: time step [s].
        every: steps from frame to frame.
        frame_count: frames that were written whole, 1 or more; frame 0 is the state before the first step.
        cavities: names of the columns of `column("pressure")` and `column("volume")`.
        cables: names of the columns of `column("tension")`, `column("pull")` and `column("cable_length")`.
        cable_paths: the points that the cables run through, and what carries them.
        pairs: names of the columns of `column("normal_force")`, `column("friction_force")` and `column("slip_speed")`.
        materials: names of the columns of `column("young_modulus")`.
        body_names: names of all bodies in the order of the scene, by which contacts number them.
        base_pivot: the point about which the base turns [mm], shape (3,).
        surfaces: everything with triangles: soft bodies with their cavities, rigid bodies, obstacles.
        planes: the infinite obstacles.
    """

    def __init__(self, path: Path, patience: float):
        """Open a recording; what a run may just be writing is read again for so long [s].

        Raises:
            RecordingError: it cannot be read.
        """
        self.path = path
        self._content = Content(path, patience)
        self.outcome, self.frame_count = self._content.progress()
        self._checksums: tuple[int, np.ndarray] = (-1, np.zeros(0))
        self._content.read(self._read_constants)

    def _read_constants(self, file: Any) -> None:
        attributes, columns = file.attrs, file["steps"].attrs
        self.scene_text = read_text(attributes, "scene")
        self.versions: dict[str, str] = json.loads(read_text(attributes, "versions"))
        self.step_size = float(attributes["step_size"])
        self.every = int(attributes["every"])
        self.cavities = read_texts(columns, "cavities")
        self.cables = read_texts(columns, "cables")
        self.cable_paths = tuple(read_cables(file))
        pairs = [pair.split("|") for pair in read_texts(columns, "pairs")]
        self.pairs: list[Pair] = [(first, second) for first, second in pairs]
        self.materials = read_texts(columns, "materials")
        self.body_names = read_texts(file["contacts"].attrs, "names")
        self.base_pivot: np.ndarray = attributes["base_pivot"]
        self.surfaces = tuple(map(self.follow, read_surfaces(file)))
        self.planes = tuple(read_planes(file))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file, as the end of a `with` statement does."""
        self._content.close()

    @cached_property
    def scene(self) -> Scene:
        """The resolved scene.

        Raises:
            SceneError: this version does not understand it; the message begins with the path.
        """
        return scene_from_toml(self.scene_text, str(self.path))

    @cached_property
    def soft_bodies(self) -> tuple[RecordedSoftBody, ...]:
        """Meshes and materials."""
        return tuple(self._content.read(read_soft_bodies))

    @property
    def times(self) -> np.ndarray:
        """Time of every frame [s], shape (frame_count,)."""
        return self.column("time")

    @property
    def last_start(self) -> int:
        """The frame with the first state of the last start: a user may have started the run anew."""
        return int(np.max(np.flatnonzero(np.diff(self.times) < 0.0) + 1, initial=0))

    def column(self, name: str) -> np.ndarray:
        """One quantity in all frames, shape (frame_count, ...); `layout.QUANTITIES` has names and units.

        Raises:
            RecordingError: there is no such quantity, or one of its numbers is damaged.
        """
        path = self._path(name)

        def read(_file: Any) -> np.ndarray:
            values: np.ndarray = self._content.dataset(path)[: self.frame_count]
            stored = self._content.dataset(CHECKSUMS)[: self.frame_count, COLUMN[path]]
            found = np.fromiter(map(checksum, values), np.uint32, len(values))
            for frame in np.flatnonzero(found != stored)[:1]:
                raise _not_as_written(path, frame)
            return values

        return self._content.read(read)

    @property
    def signals(self) -> list[str]:
        """Names of the signals that the controller has had; `column("signals")` has them in this order, NaN for none.

        Raises:
            RecordingError: they are damaged.
        """
        names: list[str] = self._content.read(lambda _file: decoded(self._content.dataset(SIGNAL_NAMES)[:]))
        return names[: max((place + 1 for place, name in enumerate(names) if name), default=0)]

    def row(self, name: str, frame: int) -> np.ndarray:
        """One quantity in one frame.

        Raises:
            RecordingError: there is no such quantity, or it is damaged.
        """
        return self._rows(self._path(name), range(self.frame_count)[frame], ...)

    def contacts(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Points [mm] and forces [mN] on the second body of each contact, each of shape (contact_count, 3)."""
        return self._contact_rows("point", frame), self._contact_rows("impulse", frame) / self.step_size

    def contact_pairs(self, frame: int) -> list[Pair]:
        """Names of the two bodies of each of these contacts."""
        return [
            (self.body_names[first], self.body_names[second]) for first, second in self._contact_rows("bodies", frame)
        ]

    def cable_points(self, frame: int) -> list[np.ndarray]:
        """Points of each cable from its pulled end on [mm], each of shape (point_count, 3)."""
        return [self.points_of_cable(path, frame) for path in self.cable_paths]

    def points_of_cable(self, path: CablePath, frame: int) -> np.ndarray:
        """Points of one of `cable_paths` from its pulled end on [mm], shape (point_count, 3)."""
        return path.points(_RecordedPoses(self, frame), self.base_pivot)

    def segment_tensions(self, frame: int) -> list[np.ndarray]:
        """Tensions between the points of each cable [mN], each of shape (point_count - 1,)."""
        return segment_tensions(self.cable_paths, self.row("tension", frame), self.row("tension_loss", frame))

    def follow(self, surface: BodySurface) -> RecordedSurface:
        """A surface of one of the bodies in the frames of this recording."""
        mapping = surface.shape if isinstance(surface.shape, MappedSurface) else None

        def vertices(frame: int) -> np.ndarray:
            return surface.vertices(_RecordedPoses(self, frame))

        return RecordedSurface(surface.name, surface.kind, surface.triangles, vertices, mapping)

    def body_axes(self, frame: int) -> np.ndarray:
        """Axes of the bodies whose axes the scene wants: origin [mm] and three unit vectors each, (count, 4, 3)."""
        poses = _RecordedPoses(self, frame)
        return np.array([axes.place(poses) for axes in self.axes_of_bodies.values()]).reshape(-1, 4, 3)

    @cached_property
    def axes_of_bodies(self) -> dict[str, BodyAxes]:
        """By name, the axes of the bodies whose axes the scene wants."""
        return axes_of_bodies(self.scene, self.soft_bodies)

    def state(self, frame: int) -> State:
        """The state in a frame, bit for bit: a run that goes on from it is the one that was recorded."""
        values: dict[str, Any] = {}
        for path, quantity in QUANTITIES.items():
            group, name = path.split("/")
            if quantity.state_field:
                read = self.row if group == "steps" else self._contact_rows
                values[quantity.state_field] = read(name, frame)
        return State(**{**values, "time": float(values["time"]), "step": int(values["step"])})

    def rows_of_frames(self, first: int, end: int) -> dict[str, np.ndarray]:
        """All that belongs to the frames from `first` to before `end`, by paths of datasets, one after the other.

        Raises:
            RecordingError: some of it is damaged.
        """

        def read(_file: Any) -> dict[str, np.ndarray]:
            dataset = self._content.dataset
            rows = {path: dataset(path)[first:end] for path in QUANTITIES if path.startswith("steps/")}
            offset, count = rows["steps/contact_offset"], rows["steps/contact_count"]
            place = slice(int(offset[0]), int(offset[-1] + count[-1]))
            rows |= {path: dataset(path)[place] for path in QUANTITIES if path.startswith("contacts/")}
            wrong = checksums(rows, place.start) != dataset(CHECKSUMS)[first:end]
            for frame, column in np.argwhere(wrong)[:1]:
                raise _not_as_written(list(QUANTITIES)[column], first + frame)
            return rows

        return self._content.read(read)

    def frame_at(self, time: float) -> int:
        """Index of the frame nearest to `time` [s] since the last start.

        Raises:
            RecordingError: the time was not recorded.
        """
        first = self.last_start
        times = self.times[first:]
        if not times[0] - self.step_size <= time <= times[-1] + self.step_size:
            reach = f"from {times[0]:g} s to {times[-1]:g} s"
            raise RecordingError(f"{self.path}: nothing at {time:g} s; the recording has {reach}")
        return first + int(np.argmin(np.abs(times - time)))

    def refresh(self) -> None:
        """See what a run in progress has written since the file was opened, or since the last call.

        Raises:
            RecordingError: it can no longer be read.
        """
        self._content.open_again()
        self.outcome, self.frame_count = self._content.progress()

    def _contact_rows(self, name: str, frame: int) -> np.ndarray:
        start = int(self.row("contact_offset", frame))
        end = start + int(self.row("contact_count", frame))
        return self._rows(f"contacts/{name}", range(self.frame_count)[frame], slice(start, end))

    def _rows(self, path: str, frame: int, place: Any) -> np.ndarray:
        """The part of a dataset that belongs to a frame: its own row, or a `place` among the contacts."""

        def read(_file: Any) -> np.ndarray:
            if self._checksums[0] != frame:
                self._checksums = (frame, self._content.dataset(CHECKSUMS)[frame])
            values: np.ndarray = self._content.dataset(path)[frame if place is ... else place]
            if checksum(values) != self._checksums[1][COLUMN[path]]:
                self._checksums = (-1, np.zeros(0))
                raise _not_as_written(path, frame)
            return values

        return self._content.read(read)

    def _path(self, name: str) -> str:
        path = f"steps/{name}"
        if path not in QUANTITIES:
            known = ", ".join(path.removeprefix("steps/") for path in QUANTITIES if path.startswith("steps/"))
            raise RecordingError(f"{self.path}: steps have no '{name}'; there are: {known}")
        return path


class LiveRecording(Recording):
    """The recording of a single frame whose quantities are replaced by those of one state after the other."""

    def show(self, values: dict[str, np.ndarray]) -> None:
        """Take over a state: its fields by the paths of `layout.QUANTITIES`, those of `steps` as a row of one frame."""
        self._values = values

    def column(self, name: str) -> np.ndarray:
        """One quantity, shape (1, ...)."""
        return self._values[self._path(name)]

    def row(self, name: str, frame: int) -> np.ndarray:
        """One quantity."""
        return self.column(name)[frame]

    def _contact_rows(self, name: str, frame: int) -> np.ndarray:
        return self._values[f"contacts/{name}"]


def live_values(state: State) -> dict[str, np.ndarray]:
    """What `LiveRecording.show` takes."""
    return {
        path: np.asarray(getattr(state, quantity.state_field))[None if path.startswith("steps") else slice(None)]
        for path, quantity in QUANTITIES.items()
        if quantity.state_field
    }


@dataclass(frozen=True)
class _RecordedPoses:
    """Where nodes and bodies are in a frame; only what is asked for is read."""

    recording: Recording
    frame: int

    @property
    def position(self) -> np.ndarray:
        return self.recording.row("position", self.frame)

    @property
    def rigid_position(self) -> np.ndarray:
        return self.recording.row("rigid_position", self.frame)

    @property
    def rigid_rotation(self) -> np.ndarray:
        return self.recording.row("rigid_rotation", self.frame)

    @property
    def base_translation(self) -> np.ndarray:
        return self.recording.row("base_translation", self.frame)

    @property
    def base_rotation(self) -> np.ndarray:
        return self.recording.row("base_rotation", self.frame)

    @property
    def pull_point(self) -> np.ndarray:
        return self.recording.row("pull_point", self.frame)


def _not_as_written(path: str, frame: int) -> DamagedContent:
    return DamagedContent(f"frame {frame}: {path} is not what was written")


def read_recording(path: str | Path, patience: float = PATIENCE) -> Recording:
    """Open a recording; use it in a `with` statement. That of a killed or running simulation opens too.

    Args:
        path: the file.
        patience: how long what a run may just be writing is read again before it counts as damaged [s].

    Raises:
        RecordingError: the file is missing or damaged, is no recording, or has another layout than this version reads.
    """
    return Recording(Path(path), patience)
