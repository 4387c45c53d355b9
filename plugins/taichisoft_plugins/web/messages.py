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
        time: Time of the run [s].
        position: Soft nodes [mm], shape (node_count, 3).
        rigid_position: Centres of mass [mm], shape (rigid_count, 3).
        rigid_rotation: Unit quaternions (w, x, y, z), shape (rigid_count, 4).
        contact_points: Points of contact [mm], shape (contact_count, 3).
        contact_forces: Forces on the second bodies [mN], shape (contact_count, 3).
        plotted: A row of `curves.plotted_row`.
        sliders: Sliders of the page by name.
        paused: Whether the run waits.
        speed: Simulated over wall-clock time that is wanted; None for as fast as it goes.
        real_time_factor: Simulated over wall-clock time that is reached; NaN where it is not known.
        status: What the controller says of itself.
    """

    time: float
    position: np.ndarray
    rigid_position: np.ndarray
    rigid_rotation: np.ndarray
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
        host, port: Where the page listens.
        token: What a viewer must enter to control the run; empty where all viewers may.
        content: What stays the same on the page.
        surfaces: The surfaces of `content`, which know where they are in a snapshot.
        first: The state before the first step.
        run_bindings: What keys of the run itself do.
        controller_bindings: What keys of the controller do; empty where it heeds none.
        sliders_move: Whether viewers may move the sliders.
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
        outcome: How it ended, as outputs are told.
    """

    outcome: str


@dataclass(frozen=True)
class Ready:
    """The page is served; the first message that its process sends.

    Attributes:
        port: Port at which the page listens.
    """

    port: int


@dataclass(frozen=True)
class SpeedWanted:
    """A viewer wants the run to go faster or slower; the page sends nothing else but `KeyEvent`.

    Attributes:
        speed: Simulated over wall-clock time; None for as fast as it goes.
    """

    speed: float | None


def send(stream: IO[bytes], message: Any) -> None:
    """Write a message; waits for a reader who is slow.

    Raises:
        OSError: Nobody reads any more.
    """
    pickle.dump(message, stream, protocol=pickle.HIGHEST_PROTOCOL)
    stream.flush()


def receive(stream: IO[bytes]) -> Any:
    """Wait for the next message.

    Raises:
        EOFError: There will be no further message.
    """
    try:
        return pickle.load(stream)
    except pickle.UnpicklingError as error:  # a writer that was killed left half a message
        raise EOFError from error
