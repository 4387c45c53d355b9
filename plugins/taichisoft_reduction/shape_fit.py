"""The reduced model of a shape: its modes and its integration domains."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

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

STATES, PERTURBED = 80, 40
"""States of the training that the domains are chosen by, and states beside them, so that stiffness counts too."""
PERTURBATION = 0.2
"""How far those are from states of the training, as a share of the amplitudes' standard deviations."""
SHARE = 0.5
"""Share of the tolerance that the integration domains may use up."""
SEED = 30


class ShapeFit:
    """The modes of a shape, and domains for them, which can be chosen again for a smaller error.

    Attributes:
        basis: all modes of the training.
        mode_count: number of modes that are used.
        cubature: the chosen domains, after `choose`.
        domain_count: number of all domains.
    """

    cubature: Cubature

    def __init__(
        self, body: "SoftBody", shape: BodyShape, displacements: Sequence[np.ndarray], tolerance: float, modes: int | None
    ):
        """Find the modes.

        Args:
            body: the first body of the shape.
            shape: the shape.
            displacements: of the training [mm], each of shape (count, node_count, 3).
            tolerance: largest error over the largest displacement [-].
            modes: number of modes; None: as many as the tolerance needs.

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
        self._forces = DomainForces(body, self.basis.modes[:, :, : self.mode_count])
        self.domain_count = self._forces.count
        self._criterion = MotionCriterion(self._forces, self._states())

    def _states(self) -> np.ndarray:
        """Amplitudes that are spread over the training, and some beside them, shape (state_count, mode_count)."""
        amplitudes = self.basis.amplitudes[:, : self.mode_count]
        some = amplitudes[np.unique(np.linspace(0, len(amplitudes) - 1, STATES).astype(int))]
        noise = np.random.default_rng(SEED).standard_normal((PERTURBED, self.mode_count))
        beside = some[:: max(1, len(some) // PERTURBED)][:PERTURBED]
        return np.vstack([some, beside + PERTURBATION * amplitudes.std(axis=0) * noise[: len(beside)]])

    def choose(self, progress: Callable[[int, float], None], part: float = 1.0) -> None:
        """Choose domains whose error is within a `part` of their share of the tolerance."""
        allowed = part * SHARE * self._tolerance * self.basis.largest
        self.cubature = choose_domains(self._criterion, self._forces.volume, allowed, progress)

    def modes(self, report: str = "{}") -> Modes:
        """What goes into the file of the shape."""
        amplitudes = self.basis.amplitudes[:, : self.mode_count]
        return Modes(
            rest_position=self._body.mesh.nodes,
            modes=self._forces.modes,
            domain=self.cubature.domain,
            weight=self.cubature.weight,
            amplitude_range=np.column_stack([amplitudes.min(axis=0), amplitudes.max(axis=0)]),
            fingerprint=self._body.fingerprint,
            tolerance=self._tolerance,
            report=report,
        )


def displacements_of(shape: BodyShape, results: Sequence[RunResult]) -> list[np.ndarray]:
    """The displacements of all copies in runs that came to their end [mm], each of shape (count, node_count, 3)."""
    found = [result.displacement for result in results if not result.problem]
    return [one[name].astype(np.float64) for one in found for name in shape.bodies if name in one]
