"""Is a new state still a simulation of something?"""

from collections.abc import Sequence

import numpy as np

from taichisoft.bodies.elasticity import Elasticity
from taichisoft.bodies.kernels.domain_deformation import Domains
from taichisoft.bodies.kernels.principal_stretches import HOOKE, MODULI, OGDEN_TERMS
from taichisoft.bodies.strain import Stretches, valid_stretch
from taichisoft.errors import SimulationDiverged
from taichisoft.model import Model
from taichisoft.state import State
from taichisoft.step.kernels import leaps as kernels

# An element under Hooke's law survives being inverted for a while; a body of which more than this share is, does not.
INVERTED_SHARE = 0.25
# Nothing moves by more than this many times its own size in a step, unless it did so before: a small body that falls
# freely does after a while, one that explodes does at once.
LARGEST_MOVE = 10.0

NO_DOMAINS = Domains(
    start=np.zeros(1, dtype=np.int32),
    node=np.zeros(0, dtype=np.int32),
    gradient=np.zeros((0, 3)),
    volume=np.zeros((0, 2)),
    law=np.zeros(0, dtype=np.int32),
    modulus=np.zeros((0, MODULI)),
    exponent=np.zeros((0, OGDEN_TERMS)),
    lag=np.zeros(0),
    factor=np.zeros(0),
    undamped=np.zeros(0),
)

ADVICE = "a smaller time.step, a lower pressure or pressure rate, or a finer mesh"
# A turn by t in a step changes volumes by t^2, which one linearisation does not see: nearly incompressible rubber that
# moves fast gets pressures of lambda t^2, and explodes.
RUBBER_ADVICE = "a smaller time.step, time.newton = 20, a lower pressure or pressure rate, or a finer mesh"
COLLAPSE_ADVICE = "less suction, or a lowest_volume_growth or lowest_pressure of the cavity"


class DivergenceCheck:
    """Compares the states before and after a step: soft bodies by their nodes, rigid ones by their centres.

    Attributes:
        inverted: number of elements of all soft bodies that are turned inside out after the step.
    """

    def __init__(self, model: Model):
        """Lay out the bodies."""
        soft, rigid = model.soft_bodies, model.rigid_bodies
        self._bodies = soft
        node_starts = [*(body.nodes.start for body in soft), model.node_count]
        self._time_step = model.scene.time.step
        self._cavities = model.cavities.names
        self._advice = [ADVICE if (body.laws.kind == HOOKE).all() else RUBBER_ADVICE for body in soft]
        shapes = [body.rest_position for body in soft]
        self._soft = _Leaps([body.name for body in soft], shapes, node_starts, self._advice)
        centres = list(range(len(rigid) + 1))
        advice = [ADVICE for _ in rigid]
        self._rigid = _Leaps([body.name for body in rigid], [body.vertices for body in rigid], centres, advice)
        counts = [len(body.elements) for body in soft]
        # Laws of rubber can push elements out again that are turned inside out, however many.
        follows_hooke = np.array([bool((body.laws.kind == HOOKE).any()) for body in soft])
        self._largest_inverted = np.where(follows_hooke, INVERTED_SHARE, 1.0) * np.array(counts)
        self.inverted = 0
        self._element_counts = counts
        if model.elasticity is not None:
            self._domains, first_point = _integration_points(model.elasticity, [body.elements.shape for body in soft])
            self._inverted = kernels.InvertedElements(
                elements=model.elasticity.elements,
                first_point=first_point,
                body_start=np.cumsum([0, *counts]).astype(np.int32),
                count=np.zeros(len(soft), dtype=np.int32),
            )

    def check(self, before: State, after: State) -> None:
        """Compare the states of a step.

        Raises:
            SimulationDiverged: a value is not finite, a body explodes, too many of its elements are inverted, or the
                walls of a cavity have gone through each other.
        """
        step = before.step
        self._rigid.refuse_not_finite(after.rigid_rotation, step)
        self._soft.check(before.position, before.velocity, after.position, step, self._time_step)
        self._rigid.check(before.rigid_position, before.rigid_velocity, after.rigid_position, step, self._time_step)
        if self._soft.names:
            self._check_inverted(before, step)
        if self._cavities:
            self._check_collapsed(after.cavity_volume, step)

    def _check_collapsed(self, volume: np.ndarray, step: int) -> None:
        """A volume [mm^3] of less than nothing is that of walls which have changed sides."""
        if volume.min() <= 0.0:
            cavity = int(np.argmin(volume))
            name = self._cavities[cavity]
            cause = f"has a collapsed cavity: the walls of '{name}' went through each other ({volume[cavity]:.3g} mm^3)"
            raise SimulationDiverged(name.partition(".")[0], step, cause, COLLAPSE_ADVICE)

    def _check_inverted(self, before: State, step: int) -> None:
        kernels.count_inverted(self._inverted, self._domains, self._soft.points.after)
        self.inverted = int(self._inverted.count.sum())
        bad = self._inverted.count > self._largest_inverted
        if bad.any():
            body = int(np.argmax(bad))
            count = f"{self._inverted.count[body]} of {self._element_counts[body]}"
            cause = f"has {count} elements turned inside out{self._beyond_its_law(body, before)}"
            raise SimulationDiverged(self._soft.names[body], step, cause, self._advice[body])

    def _beyond_its_law(self, number: int, state: State) -> str:
        """What there is to say where a body was stretched beyond the range of its law before the step."""
        body = self._bodies[number]
        found = Stretches(body.rest_position, body.elements).largest(state.position[body.nodes]).max()
        limit, law = valid_stretch(body.settings)
        return f" after being stretched {found:.2f}-fold, where {law} holds up to {limit:g}" if found > limit else ""


def _integration_points(elasticity: Elasticity, shapes: Sequence[tuple[int, ...]]) -> tuple[Domains, np.ndarray]:
    """The integration domains, and the first one of each quadratic element, -1 for others, by these bodies' shapes."""
    quadratic = np.repeat([nodes == 10 for _, nodes in shapes], [count for count, _ in shapes])
    first_point = np.full(len(quadratic), -1, dtype=np.int32)
    if elasticity.domains is None:
        return NO_DOMAINS, first_point
    element = elasticity.domains.domains.element
    some = np.flatnonzero(quadratic[element])[:: kernels.POINTS]
    first_point[element[some]] = some
    return elasticity.domains.data, first_point


class _Leaps:
    """Points of some bodies, none of which may leap in a step."""

    def __init__(self, names: list[str], shapes: Sequence[np.ndarray], starts: list[int], advice: list[str]):
        """Bodies of these shapes [mm], each (count, 3), whose points begin at these places among all.

        What to try where one of them leaps is its `advice`.
        """
        self.names, self._advice = names, advice
        self._limit = LARGEST_MOVE * np.array([np.ptp(shape, axis=0).max() for shape in shapes])
        before, velocity, after = (np.empty((starts[-1], 3)) for _ in range(3))
        self.points = kernels.Points(before, velocity, after, np.array(starts, dtype=np.int32), np.empty(len(names)))

    def check(self, before: np.ndarray, velocity: np.ndarray, after: np.ndarray, step: int, time_step: float) -> None:
        """Raise SimulationDiverged where a point is nowhere or too far away."""
        if not self.names:
            return
        self.refuse_not_finite(after, step)
        points = self.points
        points.before[:], points.velocity[:], points.after[:] = before, velocity, after
        kernels.largest_leaps(time_step, points)
        leaps = points.largest > self._limit
        if leaps.any():
            body = int(np.argmax(leaps))
            some = slice(points.body_start[body], points.body_start[body + 1])
            move = np.abs(after[some] - before[some]).max()
            cause = f"exploded: it would move {move:.3g} mm in one step, over {LARGEST_MOVE:g} times its size"
            raise SimulationDiverged(self.names[body], step, cause, self._advice[body])

    def refuse_not_finite(self, values: np.ndarray, step: int) -> None:
        """Raise SimulationDiverged for the first body with a value that is not finite; a row belongs to each point."""
        if np.isfinite(np.add.reduce(values, axis=None)):  # which is NaN or infinite where any of the values is
            return
        finite = np.isfinite(values).all(axis=1)
        if not finite.all():
            body = int(np.searchsorted(self.points.body_start, np.argmin(finite), side="right")) - 1
            raise SimulationDiverged(self.names[body], step, "has a position that is not finite", self._advice[body])
