"""The reduced model of a shape: its modes and its integration domains."""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.bodies import Modes
from taichisoft_reduction.basis import Basis
from taichisoft_reduction.body_shapes import BodyShape
from taichisoft_reduction.cubature import Cubature, MotionCriterion, choose_domains
from taichisoft_reduction.domain_forces import DomainForces
from taichisoft_reduction.errors import ReductionError
from taichisoft_reduction.run_request import RunResult

if TYPE_CHECKING:
    from taichisoft.bodies import SoftBody

STATES, PERTURBED, SPUN = 110, 40, 20
"""States of the training that the domains are chosen by, and states beside them, so that stiffness counts too,
and states that are also taken spinning."""
PERTURBATION = 0.2
"""How far those are from states of the training, as a share of the amplitudes' standard deviations."""
SHARE = 0.25
"""Share of the tolerance for the domains, in states at rest: in motion errors add up to some three times as much."""
SEED = 30


class ShapeFit:
    """The modes of a shape, and domains for them, which can be chosen again for a smaller error.

    Attributes:
        basis: all modes of the training.
        mode_count: number of modes that are used.
        cubature: the chosen domains; None for all of them, before `choose`.
        domain_count: number of all domains.
    """

    cubature: Cubature | None = None

    def __init__(
        self,
        body: "SoftBody",
        shape: BodyShape,
        displacements: Sequence[np.ndarray],
        tolerance: float,
        modes: int | None,
        lag: float,
    ):
        """Find the modes.

        Args:
            body: the first body of the shape.
            shape: the shape.
            displacements: of the training [mm], each of shape (count, node_count, 3).
            tolerance: largest error over the largest displacement [-].
            modes: number of modes; None: as many as the tolerance needs.
            lag: how far ahead along the velocities forces are taken, with Rayleigh's damping [s].

        Raises:
            ReductionError: the training has too few different states.
        """
        self._body, self._tolerance = body, tolerance
        snapshots = np.concatenate([np.zeros((0, len(body.rest_position), 3)), *displacements])
        if not len(snapshots):
            raise ReductionError(f"{shape.name}: no run of the training came to its end; see the lines above")
        self.basis = Basis(snapshots, body.node_mass)
        most = len(self.basis.singular_values)
        if modes is not None and modes > most:
            raise ReductionError(f"--modes {modes}: the training of '{shape.name}' shows {most}; ask for no more")
        self.mode_count = modes if modes is not None else self.basis.count_for(tolerance)
        self.domain_count = len(body.mesh_domains.element)
        self._lag = lag

    def _states(self) -> np.ndarray:
        """Amplitudes that are spread over the training, and some beside them, shape (state_count, mode_count)."""
        amplitudes = self.basis.amplitudes[:, : self.mode_count]
        some = amplitudes[far_apart(amplitudes, STATES)]
        beside = some[np.linspace(0, len(some) - 1, min(PERTURBED, len(some))).astype(int)]
        noise = np.random.default_rng(SEED).standard_normal(beside.shape)
        return np.vstack([some, beside + PERTURBATION * amplitudes.std(axis=0) * noise])

    def use_modes(self, count: int) -> None:
        """Use so many modes, or all that the training shows; before `choose`."""
        self.mode_count = min(count, len(self.basis.singular_values))

    @cached_property
    def _criterion(self) -> MotionCriterion:
        states = self._states()
        forces = DomainForces(self._body, self.basis.modes[:, :, : self.mode_count])
        return MotionCriterion(forces, states, states[:SPUN], self._lag)

    def choose(self, progress: Callable[[int, float], None], part: float = 1.0) -> None:
        """Choose domains whose error is within a `part` of their share of the tolerance."""
        allowed = part * SHARE * self._tolerance * self.basis.largest
        self.cubature = choose_domains(self._criterion, self._body.mesh_domains.volume, allowed, progress)

    def modes(self, **validated: Any) -> Modes:
        """What goes into the file of the shape, with what the validation found."""
        amplitudes = self.basis.amplitudes[:, : self.mode_count]
        return Modes(
            rest_position=self._body.mesh.nodes,
            modes=self.basis.modes[:, :, : self.mode_count],
            domain=None if self.cubature is None else self.cubature.domain,
            weight=None if self.cubature is None else self.cubature.weight,
            amplitude_range=np.column_stack([amplitudes.min(axis=0), amplitudes.max(axis=0)]),
            fingerprint=self._body.fingerprint,
            tolerance=self._tolerance,
            **validated,
        )


def displacements_of(shape: BodyShape, results: Sequence[RunResult]) -> list[np.ndarray]:
    """The displacements of all copies in runs that came to their end [mm], each of shape (count, node_count, 3)."""
    found = [result.displacement for result in results if not result.problem]
    return [one[name].astype(np.float64) for one in found for name in shape.bodies if name in one]


def far_apart(points: np.ndarray, count: int) -> np.ndarray:
    """Numbers of points, shape (point_count, dimension), each as far as possible from those before it, (count,)."""
    chosen = [int(np.linalg.norm(points, axis=1).argmax())]
    distance = np.full(len(points), np.inf)
    while len(chosen) < min(count, len(points)):
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
        chosen.append(int(distance.argmax()))
    return np.array(chosen)
