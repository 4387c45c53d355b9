"""Messages between a run and the worker process of its page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from taichisoft import Scene
from taichisoft.control import Slider
from taichisoft.mechanics import ActuatorNames, BodyAxes, BodySurface, Plane

# What a page draws: surfaces and planes that stay the same, and instants that say where everything is.


class LinesShown(NamedTuple):
    """Lines from point to point of all actuators of a kind, such as cables.

    Attributes:
        ends: [mm], shape (line_count, 2, 3).
        efforts: such as tensions [mN], shape (line_count,).
    """

    ends: np.ndarray
    efforts: np.ndarray


@dataclass(frozen=True)
class PageScene:
    """What stays the same while a page shows one instant after the other.

    Attributes:
        surfaces: everything with triangles.
        axes: by name, the axes of bodies that are shown.
    """

    scene: Scene
    surfaces: Sequence[BodySurface]
    planes: Sequence[Plane]
    actuators: ActuatorNames
    axes: Mapping[str, BodyAxes] = field(default_factory=dict)


class ShownPoses(NamedTuple):
    """Where soft nodes and rigid bodies are, as in `State`; positions [mm], rotations as quaternions."""

    position: np.ndarray
    rigid_position: np.ndarray
    rigid_rotation: np.ndarray


@dataclass(frozen=True)
class PageInstant:
    """What a page shows at one time, of a live run or of a recording.

    Attributes:
        time: time of the run [s].
        poses: where everything is, by fields of `State`.
        lines: of each kind of actuators drawn as lines, by its name.
        contact_points: points of contact, and of a live run of forces from outside [mm], shape (force_count, 3).
        contact_forces: forces on the second body of each contact, and from outside [mN], shape (force_count, 3).
        plotted: a row of `curves.plotted_row`, which begins with the efforts of all actuators.
        signals: numbers of the controller by name.
    """

    time: float
    poses: Any
    lines: Mapping[str, LinesShown]
    contact_points: np.ndarray
    contact_forces: np.ndarray
    plotted: np.ndarray
    signals: Mapping[str, float] = field(default_factory=dict)


def lines_shown(points: Sequence[np.ndarray], efforts: Sequence[np.ndarray]) -> LinesShown:
    """The lines of a kind of actuators.

    Args:
        points: points of each actuator [mm], each of shape (point_count, 3).
        efforts: efforts between these points, such as tensions [mN], each of shape (point_count - 1,).
    """
    lines = [np.stack([one[:-1], one[1:]], axis=1) for one in points]
    return LinesShown(np.concatenate([np.zeros((0, 2, 3)), *lines]), np.concatenate([np.zeros(0), *efforts]))


@dataclass(frozen=True)
class Snapshot:
    """A run between two steps; sent by the run.

    Attributes:
        instant: what is drawn and plotted.
        sliders: sliders of the page by name.
        paused: whether the run waits.
        speed: simulated over wall-clock time that is wanted; None for as fast as it goes.
        real_time_factor: simulated over wall-clock time that is reached; NaN where it is not known.
        status: what the controller says of itself.
    """

    instant: PageInstant
    sliders: Mapping[str, Slider]
    paused: bool
    speed: float | None
    real_time_factor: float
    status: str


@dataclass(frozen=True)
class PageSetup:
    """All that a page begins with; the first message that the run sends.

    Attributes:
        host, port: where the page listens.
        token: what viewers must know.
        content: what stays the same on the page.
        first: the state before the first step.
        run_bindings: what keys of the run itself do.
        controller_bindings: what keys of the controller do; empty where it has none.
        pullable: names of the bodies that viewers can pull.
    """

    host: str
    port: int
    token: str
    content: PageScene
    first: Snapshot
    run_bindings: Mapping[str, str]
    controller_bindings: Mapping[str, str]
    pullable: Sequence[str] = ()


@dataclass(frozen=True)
class RunEnded:
    """The run has ended; the last message that it sends.

    Attributes:
        outcome: how it ended, as in `Output.end`.
    """

    outcome: str


@dataclass(frozen=True)
class SpeedWanted:
    """A viewer wants the run to go faster or slower; the page sends nothing else but `KeyEvent`.

    Attributes:
        speed: simulated over wall-clock time; None for as fast as it goes.
    """

    speed: float | None
