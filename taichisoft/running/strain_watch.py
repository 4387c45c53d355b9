"""Says when a body is stretched beyond what its law is good for, and in the end whether the run can be trusted."""

import numpy as np

from taichisoft.bodies.strain import Stretches, spread, valid_stretch
from taichisoft.errors import BeyondLaw
from taichisoft.model import Model
from taichisoft.state import State
from taichisoft.step.report import StepReport

EVERY = 20
"""Steps from one look to the next: a look takes about as long as a step without contact."""
FAR_BEYOND = 2.0
"""A run in which 1 % of a body's elements are stretched by more than so many times what its law holds for is beyond
the law. Rubber at 2.4 has 0.53 of the force of Hooke's law; shipped scenes come to 1.57 under it, and to 1.40 of a
fitted law's 3."""
FARTHEST_BEYOND = 4.0
"""The same for a single element: at a sharp corner one may be stretched more than twice as far as all others."""


class StrainWatch:
    """Looks at the stretches of all soft bodies now and then, and keeps the largest since the run began."""

    def __init__(self, model: Model):
        """Prepare; costs nothing without soft bodies."""
        self._bodies = model.soft_bodies
        self._stretches = [Stretches(body.rest_position, body.elements) for body in self._bodies]
        self._ranges = [valid_stretch(body.settings) for body in self._bodies]
        self._waiting = True
        self.restart()

    def restart(self) -> None:
        """Forget all stretches: the run starts anew."""
        self._found = [(1.0, 1.0) for _ in self._bodies]

    def complaint(self, state: State) -> str | None:
        """The line to show, where this is the first state beyond the range; None else."""
        if state.step % EVERY:
            return None
        lines = [self._look(number, state) for number in range(len(self._bodies))]
        line = next((line for line in lines if line is not None), None)
        if line is None or not self._waiting:
            return None
        self._waiting = False
        return line

    def judge(self, state: State, report: StepReport | None) -> None:
        """Look at the last state of a run, and refuse the run where it was far beyond a law.

        Raises:
            BeyondLaw: 1 % of a body's elements were stretched by more than `FAR_BEYOND` times what its law holds for,
                one by more than `FARTHEST_BEYOND` times, or elements are inside out at the end.
        """
        for number, body in enumerate(self._bodies):
            self._look(number, state)
            (largest, most), (limit, law) = self._found[number], self._ranges[number]
            if largest > FARTHEST_BEYOND * limit or most > FAR_BEYOND * limit:
                raise BeyondLaw(
                    f"beyond the law: '{body.name}' was stretched {largest:.2f}-fold, 1 % of its elements at least "
                    f"{most:.2f}-fold, where {law} holds up to {limit:g}: what came out is not what rubber does; "
                    "try a lower pressure or thicker walls"
                )
        if report is not None and report.inverted_elements:
            raise BeyondLaw(
                f"beyond the law: {report.inverted_elements} elements are inside out at the end: what came out is not "
                "what a body does; try a smaller time.step, time.newton = 20, a lower pressure, or a finer mesh"
            )

    def _look(self, number: int, state: State) -> str | None:
        """Keep the stretches of a body; a line where one is beyond the range of its law."""
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
            f"{state.time:.2f} s, and {law} holds up to {limit:g}: beyond it, forces are not those of rubber; "
            "metrics.json has the largest stretch of the run"
        )
