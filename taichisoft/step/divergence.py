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
        self._time_step = model.scene.time.step
        self._actuators = model.actuators
        self._advice = [ADVICE if (body.laws.kind == HOOKE).all() else RUBBER_ADVICE for body in soft]
        self._names = [*(body.name for body in soft), *(body.name for body in rigid)]
        # What frames press together gives way to nothing.
        crushed = CRUSHED if any(body.follows is not None for body in rigid) else ADVICE
        self._advice += [crushed] * len(rigid)
        shapes = [*(body.rest_position for body in soft), *(body.vertices for body in rigid)]
        self._furthest = LARGEST_MOVE * np.array([np.ptp(shape, axis=0).max() for shape in shapes])
        starts = [*(body.nodes.start for body in soft), *(model.node_count + np.arange(len(rigid) + 1))]
        before, velocity, after = (np.empty((model.node_count + len(rigid), 3)) for _ in range(3))
        largest = np.empty(len(shapes))
        self._points = kernels.Points(before, velocity, after, np.array(starts, dtype=np.int32), largest)
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
        step, points, count = before.step, self._points, len(after.position)
        self._refuse_not_finite(after.rigid_rotation, step, len(self._bodies))
        points.before[:count], points.before[count:] = before.position, before.rigid_position
        points.velocity[:count], points.velocity[count:] = before.velocity, before.rigid_velocity
        points.after[:count], points.after[count:] = after.position, after.rigid_position
        self._refuse_not_finite(points.after, step)
        self._check_leaps(step)
        if self._bodies:
            self._check_inverted(before, step)
        self._check_actuators(after.actuator_value, step)

    def is_torn(self, position: np.ndarray) -> bool:
        """Whether `check` would find too many elements inverted, with nodes at positions [mm], (node_count, 3)."""
        if not self._bodies or not np.isfinite(position).all():
            return bool(self._bodies)
        self._points.after[: len(position)] = position
        kernels.count_inverted(self._inverted, self._domains, self._points.after)
        return bool((self._inverted.count > self._largest_inverted).any())

    def _refuse_not_finite(self, values: np.ndarray, step: int, first_body: int = 0) -> None:
        """Raise SimulationDiverged for the first body with a value that is not finite; a row belongs to each point."""
        if np.isfinite(np.add.reduce(values, axis=None)):  # not finite if any value is not
            return
        finite = np.isfinite(values).all(axis=1)
        if not finite.all():
            point = self._points.body_start[first_body] + np.argmin(finite)
            body = int(np.searchsorted(self._points.body_start, point, side="right")) - 1
            raise SimulationDiverged(self._names[body], step, "has a position that is not finite", self._advice[body])

    def _check_leaps(self, step: int) -> None:
        """Raise SimulationDiverged if a point is too far away."""
        points = self._points
        kernels.largest_leaps(self._time_step, points)
        leaps = points.largest > self._furthest
        if leaps.any():
            body = int(np.argmax(leaps))
            some = slice(points.body_start[body], points.body_start[body + 1])
            move = np.abs(points.after[some] - points.before[some]).max()
            cause = f"exploded: it would move {move:.3g} mm in one step, over {LARGEST_MOVE:g} times its size"
            raise SimulationDiverged(self._names[body], step, cause, self._advice[body])

    def _check_actuators(self, value: np.ndarray, step: int) -> None:
        for kind in ACTUATOR_KINDS:
            found, of_kind = self._actuators.sets[kind.name], self._actuators.of(kind, value)
            failure = found.failure(of_kind) if found.names else None
            if failure is not None:
                name, cause, advice = failure
                raise SimulationDiverged(name.partition(".")[0], step, cause, advice)

    def _check_inverted(self, before: State, step: int) -> None:
        kernels.count_inverted(self._inverted, self._domains, self._points.after)
        self.inverted = int(self._inverted.count.sum())
        bad = self._inverted.count > self._largest_inverted
        if bad.any():
            body = int(np.argmax(bad))
            count = f"{self._inverted.count[body]} of {self._element_counts[body]}"
            cause = f"has {count} elements turned inside out{self._beyond_its_law(body, before)}"
            raise SimulationDiverged(self._names[body], step, cause, self._advice[body])

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
