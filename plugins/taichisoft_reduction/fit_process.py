"""A fit in a process of its own, whose linear algebra has one thread: its sums and choices are always the same."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.errors import TaichisoftError
from taichisoft.worker import Link, Worker, WorkerLost
from taichisoft_reduction.body_shapes import BodyShape
from taichisoft_reduction.errors import ReductionError
from taichisoft_reduction.run_pool import ONE_THREAD

if TYPE_CHECKING:
    from taichisoft.bodies import SoftBody

LONGEST = 7200.0
"""Longest time of a choice of domains [s]."""


class FitProcess:
    """A `ShapeFit` elsewhere; leaving a `with` statement ends its process.

    Attributes:
        mode_count: number of modes that are used.
        domain_count: number of all domains.
        chosen_count: number of the chosen ones, after `choose`.
    """

    def __init__(
        self,
        body: "SoftBody",
        shape: BodyShape,
        displacements: Sequence[np.ndarray],
        tolerance: float,
        modes: int | None,
        lag: float,
    ):
        """Find the modes; arguments and errors are those of `ShapeFit`."""
        self._worker = Worker("taichisoft_reduction.fit_process:serve_fit", ONE_THREAD)
        try:
            self._ask((body, shape, list(displacements), tolerance, modes, lag))
        except BaseException:
            self._worker.end()
            raise

    def __enter__(self) -> "FitProcess":
        return self

    def __exit__(self, *_: object) -> None:
        self._worker.end()

    def use_modes(self, count: int) -> None:
        """See `ShapeFit.use_modes`."""
        self._ask(("use modes", count, {}))

    def choose(self, part: float = 1.0) -> None:
        """See `ShapeFit.choose`."""
        self._ask(("choose", part, {}))

    def write(self, path: Path, **validated: Any) -> None:
        """Write the file of the shape, see `ShapeFit.modes`."""
        self._ask(("write", path, validated))

    def _ask(self, message: Any) -> None:
        try:
            self.mode_count, self.domain_count, self.chosen_count = self._worker.ask(message, LONGEST)
        except (TaichisoftError, WorkerLost) as error:
            raise ReductionError(str(error)) from error


def serve_fit(link: Link) -> None:
    """Make a fit of the arguments that come first, and do what the messages after them say."""
    from taichisoft_reduction.shape_fit import ShapeFit

    fit = ShapeFit(*link.receive())
    chosen = 0
    while True:
        link.send((fit.mode_count, fit.domain_count, chosen))
        method, argument, validated = link.receive()
        if method == "choose":
            fit.choose(lambda count, error: None, argument)
            chosen = len(fit.cubature.domain) if fit.cubature is not None else 0
        elif method == "use modes":
            fit.use_modes(argument)
        else:
            fit.modes(**validated).write(argument)
