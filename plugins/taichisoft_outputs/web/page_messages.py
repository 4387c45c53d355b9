"""Messages between a run and the worker process of its page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from taichisoft.bodies import BodySurface
from taichisoft.control import Slider
from taichisoft_outputs.web.frame import LinesShown, PageScene

SHOWN_ONLY = "actuators"
"""Group of sliders that show something and cannot be moved."""


@dataclass(frozen=True)
class Snapshot:
    """A run between two steps; sent by the run. The arrays of poses are as in `State`.

    Attributes:
        time: time of the run [s].
        position: soft nodes [mm], shape (node_count, 3).
        rigid_position: centres of mass [mm], shape (rigid_count, 3).
        rigid_rotation: unit quaternions (w, x, y, z), shape (rigid_count, 4).
        lines: as in `frame.PageFrame`.
        contact_points: points of contact [mm], shape (contact_count, 3).
        contact_forces: forces on the second bodies [mN], shape (contact_count, 3).
        plotted: a row of `curves.plotted_row`.
        signals: numbers of the controller by name.
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
    lines: Mapping[str, LinesShown]
    contact_points: np.ndarray
    contact_forces: np.ndarray
    plotted: np.ndarray
    signals: Mapping[str, float]
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
        controller_bindings: what keys of the controller do; empty where it has none.
    """

    host: str
    port: int
    token: str
    content: PageScene
    surfaces: Sequence[BodySurface]
    first: Snapshot
    run_bindings: Mapping[str, str]
    controller_bindings: Mapping[str, str]


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
