"""Checks for a diverged simulation after each step."""

from collections.abc import Sequence

import numpy as np

from taichisoft.actuators.kinds import ACTUATOR_KINDS
from taichisoft.bodies.elasticity import Elasticity
from taichisoft.bodies.kernels.domain_deformation import Domains
from taichisoft.bodies.kernels.principal_stretches import HOOKE, MODULI, PURE_NUMBERS
from taichisoft.bodies.strain import Stretches, valid_stretch
from taichisoft.errors import SimulationDiverged
from taichisoft.model import Model
from taichisoft.state import State
from taichisoft.step.kernels import leaps as kernels

# Single inverted elements under Hooke's law may recover; a body with more than this fraction of them will not.
INVERTED_SHARE = 0.25
# Largest move of a point in a step, in sizes of its body, unless its velocity led there: a small body in free fall
# reaches it gradually, an exploding body at once.
LARGEST_MOVE = 10.0

NO_DOMAINS = Domains(
    start=np.zeros(1, dtype=np.int32),
    node=np.zeros(0, dtype=np.int32),
    gradient=np.zeros((0, 3)),
    volume=np.zeros((0, 2)),
    law=np.zeros(0, dtype=np.int32),
    modulus=np.zeros((0, MODULI)),
    pure_number=np.zeros((0, PURE_NUMBERS)),
    lag=np.zeros(0),
    factor=np.zeros(0),
    undamped=np.zeros(0),
)

ADVICE = "a smaller time.step, a lower pressure or pressure rate, or a finer mesh"
CRUSHED = (
    "frames that stop where rigid bodies touch what they carry, since nothing gives way there, or a smaller time.step"
)
# One linearisation misses the change of volume by t^2 in a rotation by t per step: fast, nearly incompressible rubber
# gets pressures of lambda t^2 and explodes.
RUBBER_ADVICE = "a smaller time.step, time.newton = 20, a lower pressure or pressure rate, or a finer mesh"


class DivergenceCheck:
    """Compares the states before and after a step: nodes of soft bodies, centres of rigid bodies.

    Attributes:
        inverted: number of inverted elements of all soft bodies after the step.
    """

    def __init__(self, model: Model):
        """Allocate the work space."""
        soft, rigid = model.soft_bodies, model.rigid_bodies
        self._bodies = soft
        node_starts = [*(body.nodes.start for body in soft), model.node_count]
        self._time_step = model.scene.time.step
        self._actuators = model.actuators
        self._advice = [ADVICE if (body.laws.kind == HOOKE).all() else RUBBER_ADVICE for body in soft]
        shapes = [body.rest_position for body in soft]
        self._soft = _Leaps([body.name for body in soft], shapes, node_starts, self._advice)
        centres = list(range(len(rigid) + 1))
        # What frames press together gives way to nothing.
        advice = [CRUSHED if any(body.follows is not None for body in rigid) else ADVICE for _ in rigid]
        self._rigid = _Leaps([body.name for body in rigid], [body.vertices for body in rigid], centres, advice)
        counts = [len(body.elements) for body in soft]
        # Laws of rubber can restore inverted elements, however many.
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
            SimulationDiverged: a value is not finite, a body explodes, too many of its elements are inverted, or an
                actuator fails, such as a cavity whose walls have gone through each other.
        """
        step = before.step
        self._rigid.refuse_not_finite(after.rigid_rotation, step)
        self._soft.check(before.position, before.velocity, after.position, step, self._time_step)
        self._rigid.check(before.rigid_position, before.rigid_velocity, after.rigid_position, step, self._time_step)
        if self._soft.names:
            self._check_inverted(before, step)
        self._check_actuators(after.actuator_value, step)

    def _check_actuators(self, value: np.ndarray, step: int) -> None:
        for kind in ACTUATOR_KINDS:
            found, of_kind = self._actuators.sets[kind.name], self._actuators.of(kind, value)
            failure = found.failure(of_kind) if found.names else None
            if failure is not None:
                name, cause, advice = failure
                raise SimulationDiverged(name.partition(".")[0], step, cause, advice)

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
        """Note for the message, if the body was stretched beyond the range of its law before the step."""
        body = self._bodies[number]
        found = Stretches(body.rest_position, body.elements).largest(state.position[body.nodes]).max()
        limit, law = valid_stretch(body.settings)
        return f" after being stretched {found:.2f}-fold, where {law} holds up to {limit:g}" if found > limit else ""


def _integration_points(elasticity: Elasticity, shapes: Sequence[tuple[int, ...]]) -> tuple[Domains, np.ndarray]:
    """Integration domains, and first domain of each quadratic element (-1 for others), for bodies of these shapes."""
    quadratic = np.repeat([nodes == 10 for _, nodes in shapes], [count for count, _ in shapes])
    first_point = np.full(len(quadratic), -1, dtype=np.int32)
    if elasticity.domains is None:
        return NO_DOMAINS, first_point
    element = elasticity.domains.domains.element
    some = np.flatnonzero(quadratic[element])[:: kernels.POINTS]
    first_point[element[some]] = some
    return elasticity.domains.data, first_point


class _Leaps:
    """Check of bodies whose points must not leap in a step."""

    def __init__(self, names: list[str], shapes: Sequence[np.ndarray], starts: list[int], advice: list[str]):
        """Prepare for bodies with rest positions `shapes` [mm], each (count, 3), and indices `starts` of first points.

        `advice` has the corrections to suggest for each body.
        """
        self.names, self._advice = names, advice
        self._limit = LARGEST_MOVE * np.array([np.ptp(shape, axis=0).max() for shape in shapes])
        before, velocity, after = (np.empty((starts[-1], 3)) for _ in range(3))
        self.points = kernels.Points(before, velocity, after, np.array(starts, dtype=np.int32), np.empty(len(names)))

    def check(self, before: np.ndarray, velocity: np.ndarray, after: np.ndarray, step: int, time_step: float) -> None:
        """Raise SimulationDiverged if a point is not finite or too far away."""
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
        if np.isfinite(np.add.reduce(values, axis=None)):  # not finite if any value is not
            return
        finite = np.isfinite(values).all(axis=1)
        if not finite.all():
            body = int(np.searchsorted(self.points.body_start, np.argmin(finite), side="right")) - 1
            raise SimulationDiverged(self.names[body], step, "has a position that is not finite", self._advice[body])
