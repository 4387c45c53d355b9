"""What a kind of actuator is: the words for it, its actuators in a model, and how they are measured.

An actuator has a value that depends on where bodies are (a volume, a length), a coordinate that grows with the value or
against it from 0 at rest (volume growth, pull), and an effort that does work on the coordinate (pressure, tension). It
is driven by one of the two; the other one is a result.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np

from taichisoft.base.rotations import matrices_from_quaternions
from taichisoft.mechanics.body_geometry import Poses
from taichisoft.mechanics.rigid_body_arrays import MovingFrames

if TYPE_CHECKING:
    from taichisoft.mechanics.kernels.actuator_coordinates import Coordinates, Gradient
    from taichisoft.mechanics.rigid_body_arrays import Obstacle, RigidBody
    from taichisoft.mechanics.soft_body_arrays import SoftBody
    from taichisoft.mechanics.state import State
    from taichisoft.scene.scene import Scene

# Ranges of actuators as pairs of finite numbers, also where a scene gives no limit.

# Larger than any effort [kPa, mN] or coordinate [mm^3, mm]; kernels must not get infinities.
UNLIMITED = 1e30


def limits(low: float | None, high: float | None, unless_given: float = -UNLIMITED) -> tuple[float, float]:
    """A range; `unless_given` is the lower limit where there is none."""
    return unless_given if low is None else low, UNLIMITED if high is None else high


# Actuators drawn as lines: where their points are, in a state and in a frame of a recording; this needs no kernels.


class LinePoses(Poses, Protocol):
    """Where bodies, frames and pull points are; a `State` is one. The arrays are as in `State`."""

    @property
    def frame_pose(self) -> np.ndarray: ...
    @property
    def pull_point(self) -> np.ndarray: ...


@dataclass(frozen=True)
class Line:
    """The points that an actuator runs through, such as a cable, and what carries them.

    Attributes:
        name: "body.cable".
        number: its number among the actuators of its kind; of a cable, its row in `pull_point`.
        owner: rigid body that carries each point, negative for points of soft bodies or in space, (point_count,).
        nodes: soft nodes that carry each point, shape (point_count, slots).
        weights: their weights; all 0 for points that no soft body carries, shape (point_count, slots).
        place: points that no soft body carries, in the rigid body's frame or in space, else 0 [mm], (point_count, 3).
        rest_length: length at the start [mm].
        friction: coefficient between the line and its points [-].
        has_pull_point: whether the first point is a cable's pull point, which stands in space and not on a body.
        frame: number of the frame that carries the pull point; -1 where it stays in space, or there is none.
    """

    name: str
    number: int
    owner: np.ndarray
    nodes: np.ndarray
    weights: np.ndarray
    place: np.ndarray
    rest_length: float
    friction: float = 0.0
    has_pull_point: bool = False
    frame: int = -1

    def points(self, poses: LinePoses, frames: MovingFrames) -> np.ndarray:
        """Positions of the points from the pulled end on [mm], shape (point_count, 3)."""
        place = self.place.copy()
        if self.has_pull_point:
            place[0] = poses.pull_point[self.number]
            if self.frame >= 0:
                (place[0],) = frames.places(poses.frame_pose).moved(place[:1], self.frame)
        for body in np.unique(self.owner[self.owner >= 0]):
            (turn,) = matrices_from_quaternions(poses.rigid_rotation[body, None])
            place[self.owner == body] = place[self.owner == body] @ turn.T + poses.rigid_position[body]
        return place + np.einsum("pk,pkd->pd", self.weights, poses.position[self.nodes])


def segment_efforts(lines: Sequence[Line], effort: np.ndarray, loss: np.ndarray) -> list[np.ndarray]:
    """Efforts between the points of each line, each of shape (..., point_count - 1); friction makes them differ.

    Args:
        lines: lines of all actuators of a kind.
        effort: their efforts, such as tensions at pulled ends [mN], shape (..., actuator_count); further dimensions in
            front may be frames.
        loss: efforts lost to friction at inner points, in the order of the lines with friction, (..., loss_count).
    """
    efforts, first = [], 0
    for line, pulled in zip(lines, np.moveaxis(effort, -1, 0), strict=True):
        lost = np.zeros((*effort.shape[:-1], len(line.owner) - 1))
        if line.friction:
            last = first + len(line.owner) - 2
            lost[..., 1:] = loss[..., first:last].cumsum(axis=-1)
            first = last
        efforts.append(pulled[..., None] - lost)
    return efforts


def _always(table: Any) -> bool:
    return True


@dataclass(frozen=True)
class ActuatorFigure:
    """A figure of an actuator that controllers and people see.

    Attributes:
        name: name in conditions of scripts, files and plots, such as "volume".
        unit: unit, such as "mm^3".
        observed: field of `Observation` that has it by actuator; "" for none.
        meaning: description of the value for all actuators together, where a script names none.
        total: whether that is the sum of all, not the mean.
        recorded: whether recordings, CSV files and ParaView get it.
        plotted: title of its plot; "" for none.
        plot_factor: factor on the value in plots.
        metric: what a run's metrics have of it: the "final" ones, the "largest" ones, or nothing.
        digits: digits after the point in captions; tables have one more.
    """

    name: str
    unit: str
    observed: str = ""
    meaning: str = ""
    total: bool = False
    recorded: bool = True
    plotted: str = ""
    plot_factor: float = 1.0
    metric: Literal["", "final", "largest"] = ""
    digits: int = 1


@dataclass(frozen=True)
class StateFigure(ActuatorFigure):
    """A figure that the state has for each actuator of a kind, such as the air in a cavity.

    Attributes:
        field: field of `State`, shape (actuator_count of the kind,).
        matters: whether plots show it by default for an actuator with this table in the scene.
    """

    field: str = ""
    matters: Callable[[Any], bool] = _always


@dataclass(frozen=True)
class Drive(ActuatorFigure):
    """A figure by which actuators can be driven: their effort or their coordinate.

    Attributes:
        request: key of `Control` that requests it.
        rate: key of its fastest change in limits of scenes and in steps of scripts; "" where it changes at once.
        step: change by one press of a key.
        furthest: end of sliders where no limit gives one; of coordinates with `relative` a share of the value at rest.
        nearest: other end of sliders where no limit gives one.
        relative: whether `furthest` is such a share.
        elsewhere: field of `Observation` that has it of what is driven so but is no actuator, see
            `ActuatorSet.elsewhere`; "" for none.
        more, less: what the keys + and - do, for the help.
        fits: whether an actuator with this table in the scene can be driven so.

    A table of a scene may have `lowest_NAME` and `highest_NAME`, by its name, as keys of an actuator and of limits.
    """

    request: str = ""
    rate: str = ""
    step: float = 0.0
    furthest: float = 0.0
    nearest: float = 0.0
    relative: bool = False
    elsewhere: str = ""
    more: str = ""
    less: str = ""
    fits: Callable[[Any], bool] = _always

    @property
    def words(self) -> str:
        """The name in a sentence."""
        return self.name.replace("_", " ")


@dataclass(frozen=True)
class StateDrive(Drive, StateFigure):
    """A way to drive actuators beside their efforts and coordinates, such as by valves."""


@dataclass(frozen=True)
class ActuatorKind:
    """A kind of actuator.

    Attributes:
        name, plural: such as "cavity" and "cavities"; the plural is the key of its tables in a soft body of a scene.
        effort: what does work on the coordinate.
        coordinate: what is driven otherwise.
        value: what is measured of the bodies.
        rate: rate of the value; None where it is not observed.
        figures: further figures, which states have; actuators can be driven by some of them.
        imposed: dataset of recordings that says whether the coordinate is driven.
        loss: dataset of recordings with the efforts lost at the actuators' further coordinates; "" without any.
        drawn: as the walls of bodies that have the name of the actuator, or as lines, in the colour of the effort.
        always_driven: whether a script requests its effort from the start, also where it is not named.
        make: gives the actuators of the kind in soft bodies, some of which may act on rigid bodies and obstacles, of a
            scene.
    """

    name: str
    plural: str
    effort: Drive
    coordinate: Drive
    value: ActuatorFigure
    imposed: str
    drawn: Literal["walls", "lines"]
    make: "Callable[[Scene, Sequence[SoftBody], Sequence[RigidBody], Sequence[Obstacle]], ActuatorSet]"
    rate: ActuatorFigure | None = None
    loss: str = ""
    always_driven: bool = False
    figures: tuple[StateFigure, ...] = ()

    @property
    def drives(self) -> tuple[Drive, ...]:
        """The drives that an observation shows, which keys, sliders and scripts can follow; the usual one first."""
        further = (figure for figure in self.figures if isinstance(figure, StateDrive))
        return tuple(drive for drive in (self.coordinate, self.effort, *further) if drive.observed)

    @property
    def measured(self) -> tuple[ActuatorFigure, ...]:
        """What an observation shows."""
        some = (self.effort, self.coordinate, self.value, self.rate, *self.figures)
        return tuple(one for one in some if one is not None and one.observed)


class ActuatorSet(ABC):
    """The actuators of a kind in a model, which never change.

    Attributes:
        names: "body.actuator", in order.
        rest_value: values at the start, shape (actuator_count,).
        rest_effort: efforts at the start, shape (actuator_count,).
        sign: 1 where the coordinate is the growth of the value, -1 where it is what the value lacks.
        coordinate_range, effort_range: smallest and largest, shape (actuator_count, 2).
        effort_at_stop: smallest effort where a stop of the coordinate holds it, shape (actuator_count,).
        pushes_and_pulls: whether sliders go both ways where no limit says so, shape (actuator_count,).
        soft_entries: soft nodes that each coordinate depends on.
        rigid_entries: rigid bodies that each coordinate depends on.
        coordinate_start: where the coordinates of each actuator begin, its own before further ones, which have rows of
            friction, shape (actuator_count + 1,).
        rubs: whether friction resists a coordinate's motion, shape (actuator_count,).
        compliance: by how much each actuator's coordinates give way to its efforts, (coordinate_count of it,) twice.
        has_law: whether coordinate and effort of an actuator follow a law of their own, instead of one of them being
            what is requested, shape (actuator_count,).
        takes_effort: whether the effort can be requested, shape (actuator_count,).
        lines: what a frame shows of actuators that are drawn as lines.
    """

    sign = 1.0
    lines: tuple[Line, ...] = ()

    def __init__(
        self,
        names: Sequence[str],
        rest_value: np.ndarray,
        coordinate_range: np.ndarray,
        effort_range: np.ndarray,
        soft_entries: list[np.ndarray],
    ):
        """Actuators with a coordinate each, which depend on soft bodies alone and do not stretch."""
        count = len(names)
        self.names, self.rest_value, self.soft_entries = tuple(names), rest_value, soft_entries
        self.coordinate_range, self.effort_range = coordinate_range.reshape(-1, 2), effort_range.reshape(-1, 2)
        self.rest_effort = np.zeros(count)
        self.effort_at_stop = np.full(count, -UNLIMITED)
        self.pushes_and_pulls = np.zeros(count, dtype=bool)
        self.rubs = np.zeros(count, dtype=bool)
        self.has_law = np.zeros(count, dtype=bool)
        self.takes_effort = np.ones(count, dtype=bool)
        self.rigid_entries = [np.zeros(0)] * count
        self.coordinate_start = np.arange(count + 1)
        self.compliance: Sequence[np.ndarray] = [np.zeros((1, 1))] * count

    @abstractmethod
    def shapes(self, buffers: "ActuatorBuffers") -> "ActuatorShapes":
        """What measures them, in arrays of all actuators."""

    def why_not(self, drive: Drive, number: int) -> str:
        """Why an actuator cannot be driven so, for a message; "" where it can."""
        return ""

    def elsewhere(self, drive: Drive) -> tuple[str, ...]:
        """Names of what is driven so but is no actuator itself, such as the valves of an air network."""
        return ()

    def law(self, state: "State") -> "CoordinateLaw | None":
        """The law that actuators follow in the step from a state, with their numbers in this set."""
        return None

    def start(self) -> dict[str, np.ndarray]:
        """Fields of the first state that belong to this kind, but for the request of its users."""
        return {}

    def after(self, start: "State", effort: np.ndarray, value: np.ndarray, time_step: float) -> dict[str, np.ndarray]:
        """Fields of the state after a step [s] that belong to this kind, by its efforts in the step and values after
        it.
        """
        return {}

    def failure(self, value: np.ndarray) -> tuple[str, str, str] | None:
        """Name of an actuator whose value makes no sense, what happened, and what to try; None where all are well."""
        return None


@dataclass(frozen=True)
class ActuatorBuffers:
    """Where the shapes of a kind's actuators write what they measure; the arrays belong to all actuators or are views.

    Attributes:
        first: number of the kind's first coordinate.
        coordinates: what all coordinates depend on.
        gradient: of all coordinates; `soft` and `rigid` have a row for each of their entries.
        soft: the kind's part of `gradient.soft`.
        grip: of the kind's coordinates, see `mechanics/kernels/actuator_coordinates.py`, shape (coordinate_count,).
        value: of the kind's actuators, shape (actuator_count,).
        node_count: number of soft nodes.
    """

    first: int
    coordinates: "Coordinates"
    gradient: "Gradient"
    soft: np.ndarray
    grip: np.ndarray
    value: np.ndarray
    node_count: int


class ActuatorShapes(Protocol):
    """Measures the actuators of a kind."""

    def update(self, poses: Poses, pull_point: np.ndarray) -> None:
        """Fill values and gradients for these bodies and pull points [mm], shape (cable_count, 3)."""

    def coordinates(self) -> np.ndarray:
        """The coordinates as last measured, but for constants, shape (coordinate_count,)."""


class CoordinateLaw(Protocol):
    """Coordinates as falling functions of efforts, such as the spaces of air in joined cavities by its pressures."""

    @property
    def numbers(self) -> np.ndarray:
        """Numbers of the actuators in their set, shape (n,)."""

    @property
    def lowest_effort(self) -> float:
        """The effort at which coordinates become infinite."""

    @property
    def scale(self) -> np.ndarray:
        """Sizes of coordinates, for what is left of them, shape (n,)."""

    def growth(self, effort: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates [mm^3], (n,), and slopes [mm^3/kPa], (n, n), at efforts [kPa] above the lowest."""

    def meeting(self, effort: np.ndarray, growth: np.ndarray, compliance: np.ndarray) -> np.ndarray:
        """Efforts at which bodies have the law's coordinates that at given efforts have others, and give way linearly.

        Args:
            effort, growth: efforts above the lowest, and the coordinates of the bodies there, each (n,).
            compliance: changes of these with the efforts, (n, n).
        """


# Names of actuators by their kind, and where each kind stands in arrays over all actuators.


class ActuatorNames:
    """The actuators of a model or of a recording by name, in the order of the kinds.

    Attributes:
        names: all names, "body.actuator".
    """

    def __init__(self, by_kind: Mapping[str, Sequence[str]]):
        """Take the names by the name of the kind, in the order of the kinds; a kind that is missing has none."""
        self.names = tuple(name for names in by_kind.values() for name in names)
        self._place: dict[str, slice] = {}
        first = 0
        for kind, names in by_kind.items():
            self._place[kind] = slice(first, first + len(names))
            first += len(names)

    def place(self, kind: ActuatorKind) -> slice:
        """Where the actuators of a kind stand among all."""
        return self._place.get(kind.name, slice(0, 0))

    def names_of(self, kind: ActuatorKind) -> tuple[str, ...]:
        """The names of a kind's actuators."""
        return self.names[self.place(kind)]

    def driven_by(self, kind: ActuatorKind, drive: Drive) -> tuple[str, ...]:
        """The names of a kind's actuators that can be driven so, as far as names tell: all, by effort or coordinate."""
        return self.names_of(kind) if drive in (kind.effort, kind.coordinate) else ()

    def of(self, kind: ActuatorKind, values: np.ndarray) -> np.ndarray:
        """The part of a kind in values of all actuators, such as `State.actuator_effort`, (..., actuator_count)."""
        return values[..., self.place(kind)]
