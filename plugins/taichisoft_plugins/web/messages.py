"""What a run and the process of its page tell each other, one pickled object after the other through pipes."""

import pickle
from collections.abc import Mapping
from dataclasses import dataclass
from typing import IO, Any

import numpy as np

from taichisoft.control.controller import Slider
from taichisoft_plugins.web.live_bodies import LiveBodies


@dataclass(frozen=True)
class Snapshot:
    """A run between two steps; from the run to its page.

    Attributes:
        time: [s].
        position: soft nodes [mm], shape (node_count, 3).
        rigid_position: centres of mass [mm], shape (rigid_count, 3).
        rigid_rotation: unit quaternions (w, x, y, z), shape (rigid_count, 4).
        contact_points: [mm], shape (contact_count, 3).
        contact_forces: on the second bodies [mN], shape (contact_count, 3).
        pressures: [kPa] by cavity.
        normal_forces: [mN] by pair of bodies.
        sliders: by name.
        paused: whether the run waits.
        speed: simulated over wall-clock time that is wanted; None for as fast as it goes.
        real_time_factor: the same as it is; NaN where that is not known.
        status: what the controller says of itself.
    """

    time: float
    position: np.ndarray
    rigid_position: np.ndarray
    rigid_rotation: np.ndarray
    contact_points: np.ndarray
    contact_forces: np.ndarray
    pressures: Mapping[str, float]
    normal_forces: Mapping[str, float]
    sliders: Mapping[str, Slider]
    paused: bool
    speed: float | None
    real_time_factor: float
    status: str


@dataclass(frozen=True)
class Opening:
    """All that a page begins with; the first message to it.

    Attributes:
        host, port: where it listens.
        token: what a viewer must enter to control the run; empty where all may.
        bodies: what is drawn.
        first: the state before the first step.
        run_bindings: what keys of the run itself do.
        controller_bindings: what keys of the controller do; empty where it heeds none at the moment.
        sliders_move: whether sliders may be moved; otherwise they only show.
    """

    host: str
    port: int
    token: str
    bodies: LiveBodies
    first: Snapshot
    run_bindings: Mapping[str, str]
    controller_bindings: Mapping[str, str]
    sliders_move: bool


@dataclass(frozen=True)
class Farewell:
    """The run has ended; the last message to a page.

    Attributes:
        outcome: as outputs are told.
    """

    outcome: str


@dataclass(frozen=True)
class Ready:
    """The page is served; the first message from it.

    Attributes:
        port: it listens there.
    """

    port: int


@dataclass(frozen=True)
class SpeedWanted:
    """A viewer wants the run to go faster or slower; from the page, which else only sends `KeyEvent`.

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
        EOFError: there will be none.
    """
    try:
        return pickle.load(stream)
    except pickle.UnpicklingError as error:  # a writer that was killed left half a message
        raise EOFError from error
