"""What a run and the process of its page tell each other, one pickled object after the other through pipes."""

import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import IO, Any

import numpy as np

from taichisoft.bodies.surfaces import BodySurface
from taichisoft.control.controller import Slider
from taichisoft_plugins.web.frame import PageScene


@dataclass(frozen=True)
class Snapshot:
    """A run between two steps; sent by the run. The arrays of poses are those of `State`.

    Attributes:
        time: time of the run [s].
        position: soft nodes [mm], shape (node_count, 3).
        rigid_position: centres of mass [mm], shape (rigid_count, 3).
        rigid_rotation: unit quaternions (w, x, y, z), shape (rigid_count, 4).
        cable_lines, cable_tensions: as in `frame.Frame`.
        contact_points: points of contact [mm], shape (contact_count, 3).
        contact_forces: forces on the second bodies [mN], shape (contact_count, 3).
        plotted: a row of `curves.plotted_row`.
        sliders: sliders of the page by name.
        paused: whether the run waits.
        speed: simulated over wall-clock time that is wanted; None for as fast as it goes.
        real_time_factor: simulated over wall-clock time that is reached; NaN where it is not known.
        status: what the controller says of itself.
    """

    time: float
    position: np.ndarray
    rigid_position: np.ndarray
    rigid_rotation: np.ndarray
    cable_lines: np.ndarray
    cable_tensions: np.ndarray
    contact_points: np.ndarray
    contact_forces: np.ndarray
    plotted: np.ndarray
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
        surfaces: the surfaces of `content`, which know where they are in a snapshot.
        first: the state before the first step.
        run_bindings: what keys of the run itself do.
        controller_bindings: what keys of the controller do; empty where it heeds none.
        sliders_move: whether viewers may move the sliders.
    """

    host: str
    port: int
    token: str
    content: PageScene
    surfaces: Sequence[BodySurface]
    first: Snapshot
    run_bindings: Mapping[str, str]
    controller_bindings: Mapping[str, str]
    sliders_move: bool


@dataclass(frozen=True)
class RunEnded:
    """The run has ended; the last message that it sends.

    Attributes:
        outcome: how it ended, as outputs are told.
    """

    outcome: str


@dataclass(frozen=True)
class Ready:
    """The page is served; the first message that its process sends.

    Attributes:
        port: port at which the page listens.
    """

    port: int


@dataclass(frozen=True)
class SpeedWanted:
    """A viewer wants the run to go faster or slower; the page sends nothing else but `KeyEvent`.

    Attributes:
        speed: simulated over wall-clock time; None for as fast as it goes.
    """

    speed: float | None


def send(stream: IO[bytes], message: Any) -> None:
    """Write a message; waits for a reader who is slow.

    Raises:
        OSError: nobody reads any more.
    """
    pickle.dump(message, stream, protocol=pickle.HIGHEST_PROTOCOL)
    stream.flush()


def receive(stream: IO[bytes]) -> Any:
    """Wait for the next message.

    Raises:
        EOFError: there will be no further message.
    """
    try:
        return pickle.load(stream)
    except pickle.UnpicklingError as error:  # a writer that was killed left half a message
        raise EOFError from error
