"""Reading a recording: what was simulated, and what was in every instant."""

import base64
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from taichisoft import Scene
from taichisoft.control import AIR_NODES, AIR_PARTS, BASE, Figure, Pair
from taichisoft.mechanics import (
    ACTUATOR_KINDS,
    CABLES,
    CAVITIES,
    ActuatorKind,
    ActuatorNames,
    BodyAxes,
    BodySurface,
    Line,
    State,
    anchor_stiffness,
    axes_of_bodies,
    segment_efforts,
    select_nodes,
)
from taichisoft.mesh import MappedSurface
from taichisoft.running import make_output
from taichisoft.scene import scene_from_toml
from taichisoft_outputs.recording.bodies import (
    RecordedSoftBody,
    RecordedSurface,
    read_frames,
    read_lines,
    read_planes,
    read_soft_bodies,
    read_surfaces,
    read_texts,
)
from taichisoft_outputs.recording.layout import CONTROLS, LAYOUT, QUANTITIES, RecordingError, group_of
from taichisoft_outputs.recording.recording_file import (
    WHAT_DAMAGE_RAISES,
    FinishedRecording,
    Rescue,
    RunningRecording,
    convert,
    one_line,
    open_recording,
)
from taichisoft_outputs.run_figures import last_at_rest

if TYPE_CHECKING:
    from taichisoft.control import Fingertips


WRENCHES = {
    "base_force": (slice(0, 1), 0),
    "base_torque": (slice(0, 1), 1),
    "frame_force": (slice(1, None), 0),
    "frame_torque": (slice(1, None), 1),
}
"""Frames and part of the quantity `frame_wrench` that a figure is."""


@dataclass(frozen=True)
class InlineVideo:
    """A video that notebooks show.

    Attributes:
        mp4: content of the file.
    """

    mp4: bytes = field(repr=False)

    def _repr_html_(self) -> str:
        data = base64.b64encode(self.mp4).decode()
        return f'<video controls loop style="max-width: 100%" src="data:video/mp4;base64,{data}"></video>'


class Recording:
    """An open recording; steps are read when they are asked for, and what is damaged is an error.

    Attributes:
        path: the file.
        scene_text: the resolved scene as TOML.
        versions: versions of taichisoft and of what it computed with, by name.
        step_size: time step [s].
        every: steps from instant to instant.
        actuators: names of the actuators; `actuators.names_of(kind)` are the names of the columns of one kind.
        cavities: names of the columns of `column("pressure")` and `column("volume")`.
        cables: names of the columns of `column("tension")`, `column("pull")` and `column("cable_length")`.
        pairs: names of the columns of `column("normal_force")`, `column("peak_pressure")` and the like.
        materials: names of the columns of `column("young_modulus")`.
        body_names: names of all bodies in the order of the scene, by which contacts number them.
        instants: what carried bodies, the base first, by which `column("frame_pose")` and `column("frame_wrench")` are
            numbered.
        surfaces: everything with triangles: soft bodies with cavities, membranes and fibres, rigid bodies, obstacles.
        body_surfaces: the same, by the poses of the bodies.
        planes: the infinite obstacles.
    """

    def __init__(self, path: Path):
        """Open a recording.

        Raises:
            RecordingError: it cannot be read.
        """
        self.path = path
        self._file = self._opened()
        try:
            with self._errors_of_one_line():
                self._check_layout()
                self._read_constants(self._file.constants)
                if self.instant_count < 1:
                    raise RecordingError(f"{path}: damaged: no instant is left; {self._advice}")
        except RecordingError:
            self.close()
            raise

    def _opened(self) -> RunningRecording | FinishedRecording:
        if not self.path.is_file():
            raise RecordingError(f"{self.path}: no such recording; `taichisoft run` writes one into its output folder")
        try:
            return open_recording(self.path)
        except PermissionError as error:
            raise RecordingError(f"{self.path}: cannot be read: {error.strerror or error}") from error
        except WHAT_DAMAGE_RAISES as error:
            raise RecordingError(f"{self.path}: not readable as HDF5: {one_line(error)}; {self._advice}") from error

    def _check_layout(self) -> None:
        attributes = self._file.constants.attrs
        if "taichisoft_version" not in attributes:
            raise RecordingError(f"{self.path}: not a recording of taichisoft")
        layout = attributes.get("layout", "none")
        if layout != LAYOUT:
            version = attributes["taichisoft_version"]
            version = version if isinstance(version, str) else version.decode()
            raise RecordingError(
                f"{self.path}: taichisoft {version} wrote it in layout {layout}, this version reads layout {LAYOUT}; "
                "run the scene again"
            )

    @property
    def outcome(self) -> str:
        """How the run ended; "unfinished" while it runs and when it was killed."""
        return self._file.outcome

    @property
    def instant_count(self) -> int:
        """Instants that were written, 1 or more; instant 0 is the state before the first step."""
        return self._file.instant_count

    @property
    def signals(self) -> list[str]:
        """Names of the signals that the controller has had; `column("signals")` has them in this order, NaN for none.

        Raises:
            RecordingError: they are damaged.
        """
        with self._errors_of_one_line():
            return self._file.signals

    @property
    def _advice(self) -> str:
        return f"taichisoft recording repair {self.path} -o NEW.h5 rescues all instants that are whole"

    @contextmanager
    def _errors_of_one_line(self) -> Iterator[None]:
        try:
            yield
        except WHAT_DAMAGE_RAISES as error:
            raise RecordingError(f"{self.path}: damaged: {one_line(error)}; {self._advice}") from error

    def _read_constants(self, file: Any) -> None:
        columns = {name: read_texts(texts) for name, texts in file["columns"].items()}
        (self.scene_text,) = read_texts(file["scene"])
        self.versions: dict[str, str] = json.loads(file.attrs["versions"])
        self.step_size = float(file.attrs["step_size"])
        self.every = int(file.attrs["every"])
        self.actuators = ActuatorNames({kind.name: columns[kind.plural] for kind in ACTUATOR_KINDS})
        self.cavities, self.cables = (list(self.actuators.names_of(kind)) for kind in (CAVITIES, CABLES))
        self._lines = {kind.name: tuple(read_lines(file, kind)) for kind in ACTUATOR_KINDS if kind.drawn == "lines"}
        self.materials, self.body_names = columns["materials"], columns["bodies"]
        pairs = [pair.split("|") for pair in columns["pairs"]]
        self.pairs: list[Pair] = [(first, second) for first, second in pairs]
        self.frames = read_frames(file)
        self.body_surfaces = tuple(read_surfaces(file))
        self.surfaces = tuple(map(self.follow, self.body_surfaces))
        self.planes = tuple(read_planes(file))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file, as the end of a `with` statement does."""
        self._file.close()

    def video(self, **options: Any) -> "InlineVideo":
        """Draw it into a video, which notebooks show inline; `options` are those of the output "video".

        Raises:
            TaichisoftError: an option is not valid, or this machine cannot draw.
        """
        with TemporaryDirectory(prefix="taichisoft-video-") as folder:
            file = Path(folder) / "video.mp4"
            output: Any = make_output("video", folder, file=file, **options)
            output.draw(self.path)
            return InlineVideo(file.read_bytes())

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
        with self._errors_of_one_line():
            return tuple(read_soft_bodies(self._file.constants))

    @property
    def times(self) -> np.ndarray:
        """Time of every instant [s], shape (instant_count,)."""
        return self.column("time")

    @property
    def last_start(self) -> int:
        """The instant with the first state of the last start: a user may have started the run again."""
        return int(np.max(np.flatnonzero(np.diff(self.times) < 0.0) + 1, initial=0))

    @property
    def lift_start(self) -> int:
        """The instant from which lifts count, as in metrics.json: the last before the base moves; else `last_start`."""
        rest = last_at_rest(self.base_translation[self.last_start :])
        return self.last_start + (rest or 0)

    def column(self, name: str) -> np.ndarray:
        """One quantity in all instants, shape (instant_count, ...); `layout.QUANTITIES` has names and units.

        Raises:
            RecordingError: the quantity is missing, or one of its numbers is damaged.
        """
        return self._rows(self._path(name), 0, self.instant_count)

    @property
    def base_translation(self) -> np.ndarray:
        """Shift of the base from rest in every instant [mm], shape (instant_count, 3)."""
        shift: np.ndarray = self.column("frame_pose")[:, 0, 0]
        return shift

    def row(self, name: str, instant: int) -> np.ndarray:
        """One quantity in one instant; positions are in double precision where the instant has a state.

        Raises:
            RecordingError: the quantity is missing, or it is damaged.
        """
        path, instant = self._path(name), range(self.instant_count)[instant]
        if name == "position" and self.has_state(instant):
            path = "states/position"
        values: np.ndarray = self._rows(path, instant, instant + 1)[0]
        return values.astype(np.float64) if QUANTITIES[path].single else values

    def has_state(self, instant: int) -> bool:
        """Whether an instant has a whole state, in double precision; every tenth step has one, and the last."""
        return bool(self.row("state_count", instant))

    def figure(self, figure: Figure, instants: Any) -> tuple[Sequence[Any], np.ndarray]:
        """Names and values of a recorded figure in an instant, shape (name_count,), of vectors (name_count, 3).

        An array of instants is the first dimension of the values.
        """
        if figure.name in WRENCHES:
            frames, part = WRENCHES[figure.name]
            carriers = [""] if figure.per is BASE else self.frames.names[frames]
            return carriers, self.read("frame_wrench", instants)[..., frames, part, :]
        if figure.per in (AIR_NODES, AIR_PARTS):
            air = self.scene.air
            return air.nodes if figure.per is AIR_NODES else list(air.parts), self.read(figure.name, instants)
        kind = figure.per.kind
        return self.pairs if kind is None else self.actuators.names_of(kind), self.read(figure.name, instants)

    def read(self, name: str, instants: Any) -> np.ndarray:
        """One quantity in an instant, or in an array of them."""
        return self.row(name, instants) if np.ndim(instants) == 0 else self.column(name)[instants]

    def velocity(self, instant: int) -> np.ndarray:
        """Velocities of the soft nodes [mm/s], (node_count, 3); without a state, the mean since the instant before."""
        if self.has_state(instant):
            return self._group_rows("states/velocity", instant)[0]
        way = self.row("position", instant) - self.row("position", instant - 1)
        mean: np.ndarray = way / (self.row("time", instant) - self.row("time", instant - 1))
        return mean

    def contacts(self, instant: int) -> tuple[np.ndarray, np.ndarray]:
        """Points [mm] and forces [mN] on the second body of each contact, each of shape (contact_count, 3)."""
        points, impulses = (self._group_rows(f"contacts/{name}", instant) for name in ("point", "impulse"))
        return points, impulses / self.step_size

    def contact_state(self, instant: int) -> Any:
        """The part of a `State` that shows where bodies press each other."""
        fields = {QUANTITIES[path].state_field: path for path in QUANTITIES if group_of(path) == "contacts"}
        places = {name: self.row(name, instant) for name in ("position", "rigid_position", "rigid_rotation")}
        contacts = {name: self._group_rows(path, instant) for name, path in fields.items()}
        return SimpleNamespace(**places, **contacts, velocity=self.velocity(instant))

    def contact_pairs(self, instant: int) -> list[Pair]:
        """Names of the two bodies of each of these contacts."""
        bodies = self._group_rows("contacts/bodies", instant)
        return [(self.body_names[first], self.body_names[second]) for first, second in bodies]

    def cable_points(self, instant: int) -> list[np.ndarray]:
        """Points of each cable from its pulled end on [mm], each of shape (point_count, 3)."""
        return self.line_points(CABLES, instant)

    def lines(self, kind: ActuatorKind) -> tuple[Line, ...]:
        """The lines of a kind's actuators: the points that they run through, and what carries them."""
        return self._lines.get(kind.name, ())

    def line_points(self, kind: ActuatorKind, instant: int) -> list[np.ndarray]:
        """Points of each line of a kind, of cables from the pulled end on [mm], each of shape (point_count, 3)."""
        return [self.points_of_line(line, instant) for line in self.lines(kind)]

    def points_of_line(self, line: Line, instant: int) -> np.ndarray:
        """Points of one of `lines` [mm], shape (point_count, 3)."""
        return line.points(self.poses(instant), self.frames)

    def segment_efforts(self, kind: ActuatorKind, instants: Any) -> list[np.ndarray]:
        """Efforts between the points of each line of a kind, such as tensions [mN], each (..., point_count - 1).

        Args:
            kind: the kind.
            instants: an instant, or an array of instants, which are the first dimension of the efforts.
        """
        lost = self.read(kind.loss, instants) if kind.loss else np.zeros(0)
        return segment_efforts(self.lines(kind), self.read(kind.effort.name, instants), lost)

    def follow(self, surface: BodySurface) -> RecordedSurface:
        """A surface of one of the bodies in the instants of this recording."""
        mapping = surface.shape if isinstance(surface.shape, MappedSurface) else None

        def vertices(instant: int) -> np.ndarray:
            return surface.vertices(self.poses(instant))

        return RecordedSurface(surface.name, surface.kind, surface.triangles, vertices, mapping)

    def body_axes(self, instant: int) -> np.ndarray:
        """Axes of the bodies whose axes the scene wants: origin [mm] and three unit vectors each, (count, 4, 3)."""
        poses = self.poses(instant)
        return np.array([axes.place(poses) for axes in self.axes_of_bodies.values()]).reshape(-1, 4, 3)

    @cached_property
    def axes_of_bodies(self) -> dict[str, BodyAxes]:
        """By name, the axes of the bodies whose axes the scene wants."""
        return axes_of_bodies(self.scene, self.soft_bodies)

    def state(self, instant: int) -> State:
        """The state in an instant that has one, bit for bit: a run that goes on from it is the one that was recorded.

        Raises:
            RecordingError: it has none (see `has_state`), or it is damaged.
        """
        instant = range(self.instant_count)[instant]
        if not self.has_state(instant):
            raise RecordingError(f"{self.path}: instant {instant} has no state of its own, in double precision")
        parts: dict[str, np.ndarray] = {}
        for path, quantity in QUANTITIES.items():
            if quantity.state_field and not quantity.single and group_of(path) != "controls":
                rows = self._rows(path, instant, instant + 1)
                parts[path] = rows if group_of(path) == "contacts" else rows[0]
        values: dict[str, Any] = _fields(parts)
        return State(**{**values, "time": float(values["time"]), "step": int(values["step"])})

    def field(self, name: str, instant: int) -> np.ndarray:
        """A field of the state in an instant, also one whose parts are several quantities; not positions.

        Raises:
            RecordingError: it is damaged.
        """
        paths = [path for path, one in QUANTITIES.items() if one.state_field == name and group_of(path) == "steps"]
        return _fields({path: self.row(path.removeprefix("steps/"), instant) for path in paths})[name]

    def controls(self, instant: int) -> list[dict[str, np.ndarray]]:
        """What a controller acted through in each step since the instant before, by the fields of `State`."""
        between = _fields({path: self._group_rows(path, instant) for path in CONTROLS})
        own = _fields({path: self.row(path.split("/")[1], instant) for path in CONTROLS})
        count = int(self.row("control_count", instant))
        return [*({field: rows[step] for field, rows in between.items()} for step in range(count)), own]

    def controller_state(self, instant: int) -> dict[str, Any] | None:
        """What the controller remembered after an instant's step, as its `save` gave it; None: it does not save.

        Raises:
            RecordingError: it is damaged.
        """
        text = self._group_rows("controllers/saved", instant).tobytes()
        return json.loads(text) if text else None

    def rows_of_instants(self, first: int, end: int) -> dict[str, np.ndarray]:
        """All that belongs to the instants from `first` to before `end`, by paths of datasets, one after the other.

        Raises:
            RecordingError: some of it is damaged.
        """
        with self._errors_of_one_line():
            return self._file.all_rows(first, end)

    def rescue(self, new: Path) -> Rescue:
        """Write a plain HDF5 file with every instant that is whole.

        Args:
            new: place of the file; what is there is replaced.

        Raises:
            RecordingError: nothing can be rescued, or the file cannot be written.
        """
        if new.resolve() == self.path.resolve():
            raise RecordingError(f"--output {new}: is the damaged recording; name another file")
        with self._errors_of_one_line():
            return convert(self._file, new)

    def instant_at(self, time: float) -> int:
        """Index of the instant nearest to `time` [s] since the last start.

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
        opened = self._opened()
        self._file.close()
        self._file = opened

    def _rows(self, path: str, first: int, end: int) -> np.ndarray:
        with self._errors_of_one_line():
            return self._file.rows(path, first, end)

    def _group_rows(self, path: str, instant: int) -> np.ndarray:
        instant = range(self.instant_count)[instant]
        return self._rows(path, instant, instant + 1)

    def poses(self, instant: int) -> Any:
        """Where nodes and bodies are in an instant, by the fields of `State`; each is read when it is wanted."""
        return _RecordedPoses(self, instant)

    def _path(self, name: str) -> str:
        path = f"steps/{name}"
        if path not in QUANTITIES:
            known = ", ".join(path.removeprefix("steps/") for path in QUANTITIES if path.startswith("steps/"))
            raise RecordingError(f"{self.path}: steps have no '{name}'; there are: {known}")
        return path


def _fields(parts: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Quantities by the fields of `State`; for quantities of actuators, the parts of all kinds in one array."""
    fields: dict[str, np.ndarray] = {}
    for path, part in parts.items():
        field = QUANTITIES[path].state_field
        fields[field] = np.concatenate([fields[field], part], axis=-1) if field in fields else part
    return fields


class _RecordedPoses:
    def __init__(self, recording: Recording, instant: int):
        self._recording, self._instant = recording, instant

    def __getattr__(self, field: str) -> Any:
        values = self._recording.row(field, self._instant)
        setattr(self, field, values)
        return values


def read_recording(path: str | Path) -> Recording:
    """Open a recording; use it in a `with` statement. That of a killed or running simulation opens too.

    Raises:
        RecordingError: the file is missing or damaged, not a recording, or has another layout than this version reads.
    """
    return Recording(Path(path))


# The tips of the fingers of a recording, as the controller of its run observed them.


def recorded_fingertips(recording: Recording, bodies: Sequence[RecordedSoftBody]) -> "Fingertips":
    """What observes the tips of some bodies of a recording; `tip_state` is what it looks at."""
    from taichisoft.control import Fingertips

    fingers: Any = tuple(_finger(recording, body) for body in bodies)
    return Fingertips(fingers, recording.frames)


def _finger(recording: Recording, body: RecordedSoftBody) -> SimpleNamespace:
    """The part of the engine's `SoftBody` that shows where the tip is."""
    settings, mesh = recording.scene.soft_bodies[body.name], body.mesh(str(recording.path))
    return SimpleNamespace(
        name=body.name,
        settings=settings,
        nodes=body.nodes,
        rest_position=body.rest_position,
        anchored=anchor_stiffness(mesh, settings.anchors, f"{body.name}.anchors").any(axis=1),
        tip_nodes=None if settings.tip is None else select_nodes(mesh, settings.tip, f"{body.name}.tip"),
    )


def tip_state(recording: Recording, instant: int) -> Any:
    """The part of a `State` that shows where the tips are; velocities are not used."""
    position, frame_pose = recording.row("position", instant), recording.row("frame_pose", instant)
    return SimpleNamespace(position=position, velocity=np.zeros_like(position), frame_pose=frame_pose)
