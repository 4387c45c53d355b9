"""Checks for stretches beyond the range of a body's law, in steps, in equilibria, and at the end of a run."""

from functools import cached_property

import numpy as np

from taichisoft.bodies.strain import Stretches, spread, valid_stretch
from taichisoft.errors import BeyondLaw
from taichisoft.model import Model
from taichisoft.state import State
from taichisoft.step.report import StepReport

EVERY = 20
"""Steps between two checks: a check takes about as long as a step without contact."""
FAR_BEYOND = 2.0
"""A run is beyond a law if 1 % of a body's elements are stretched by more than this multiple of the law's range. At a
stretch of 2.4 rubber has 0.53 of the force of Hooke's law; shipped scenes reach 1.57 under Hooke's law, and 1.40 under
a fitted law with range 3."""
FARTHEST_BEYOND = 4.0
"""The multiple for a single element: at a sharp corner it may be stretched more than twice as far as all others."""


class StrainWatch:
    """Measures the stretches of all soft bodies when it is asked, and keeps the largest."""

    def __init__(self, model: Model):
        """Prepare; without soft bodies there is nothing to do."""
        self._bodies = model.soft_bodies
        self._ranges = [valid_stretch(body.settings) for body in self._bodies]
        self._waiting = True
        self.restart()

    @cached_property
    def _stretches(self) -> list[Stretches]:
        return [Stretches(body.rest_position, body.elements) for body in self._bodies]

    def restart(self, is_new_run: bool = False) -> None:
        """Forget the largest stretches when a run restarts; in a new run say again what is beyond a law."""
        self._found = [(1.0, 1.0) for _ in self._bodies]
        self._waiting = self._waiting or is_new_run

    def over_law(self, state: State) -> dict[str, float]:
        """By soft body: largest stretch of an element, over that up to which its law holds [-]; 0 of a law without."""
        return {
            body.name: float(stretches.largest(state.position[body.nodes]).max()) / limit
            for body, stretches, (limit, _) in zip(self._bodies, self._stretches, self._ranges, strict=True)
        }

    def complaint(self, state: State) -> str | None:
        """Line for the first state with a body beyond the range of its law, else None."""
        lines = [self._measure_stretches(number, state) for number in range(len(self._bodies))]
        line = next((line for line in lines if line is not None), None)
        if line is None or not self._waiting:
            return None
        self._waiting = False
        return line

    def judge(self, state: State, report: StepReport | None) -> None:
        """Check the last state of a run, and refuse the run if a body was stretched far beyond its law.

        Raises:
            BeyondLaw: 1 % of a body's elements were stretched by more than `FAR_BEYOND` times the range of its law, one
                by more than `FARTHEST_BEYOND` times, or elements are inverted at the end.
        """
        for number, body in enumerate(self._bodies):
            self._measure_stretches(number, state)
            (largest, most), (limit, law) = self._found[number], self._ranges[number]
            if largest > FARTHEST_BEYOND * limit or most > FAR_BEYOND * limit:
                raise BeyondLaw(
                    f"beyond the law: '{body.name}' was stretched {largest:.2f}-fold, 1 % of its elements at least "
                    f"{most:.2f}-fold, where {law} holds up to {limit:g}: the result is not physical; "
                    "try a lower pressure or thicker walls"
                )
        if report is not None and report.inverted_elements:
            raise BeyondLaw(
                f"beyond the law: {report.inverted_elements} elements are inverted at the end: the result is not "
                "physical; try a smaller time.step, time.newton = 20, a lower pressure, or a finer mesh"
            )

    def _measure_stretches(self, number: int, state: State) -> str | None:
        """Update the largest stretches of a body; returns a warning if one is beyond the range of its law."""
        body, stretches = self._bodies[number], self._stretches[number]
        position = state.position[body.nodes]
        found = stretches.largest(position)
        largest, most = spread(found)
        before = self._found[number]
        self._found[number] = max(largest, before[0]), max(most, before[1])
        limit, law = self._ranges[number]
        if largest <= limit:
            return None
        x, y, z = position[stretches.tetrahedra[int(np.argmax(found))]].mean(axis=0)
        return (
            f"'{body.name}' is stretched {largest:.2f}-fold at ({x:.1f}, {y:.1f}, {z:.1f}) mm at "
            f"{state.time:.2f} s, and {law} holds up to {limit:g}: beyond it, forces are not realistic; "
            "metrics.json of a run has the largest stretch"
        )
