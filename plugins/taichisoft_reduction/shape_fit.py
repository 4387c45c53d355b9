"""The reduced model of a shape: its modes and its integration domains."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.linalg
from scipy.spatial.transform import Rotation

from taichisoft.mechanics import ELEMENT_KINDS, Modes
from taichisoft_outputs.stress import DomainLaw, hooke_stress_parts, polar_rotations, rubber_stress_parts
from taichisoft_reduction.body_shapes import BodyShape
from taichisoft_reduction.errors import ReductionError
from taichisoft_reduction.training_run import RunResult

if TYPE_CHECKING:
    from taichisoft.mechanics import SoftBody

# The modes of a shape: displacements that make up those of the training best, measured in the mass.
#
# Proper orthogonal decomposition by the method of snapshots (Sirovich 1987): with the displacements u_s of the
# training, the singular vectors of U = [M^(1/2) u_1, M^(1/2) u_2, ...].

SMALLEST = 1e-7
"""Singular values below this share of the largest are noise: displacements are kept in single precision."""
SHARE = 0.25
"""Share of the tolerance that the modes may use up; the rest is for the integration domains."""


class Basis:
    """All modes that the training shows, the most important first.

    Attributes:
        modes: orthonormal in the mass [1/sqrt(kg)], shape (node_count, 3, mode_count).
        singular_values: [mm sqrt(kg)], shape (mode_count,).
        amplitudes: of the displacements of the training [mm sqrt(kg)], shape (snapshot_count, mode_count).
    """

    def __init__(self, displacements: np.ndarray, node_mass: np.ndarray):
        """Decompose displacements [mm], shape (snapshot_count, node_count, 3), with node masses [kg], (node_count,)."""
        self._displacements, self._mass = displacements, node_mass
        root = np.sqrt(node_mass)[:, None]
        weighted = (displacements * root).reshape(len(displacements), -1)
        values, vectors = scipy.linalg.eigh(weighted @ weighted.T)
        values, vectors = values[::-1], vectors[:, ::-1]
        if not values[0] > 0.0:
            raise ReductionError("nothing moved in the training: no actuator, no motion of the base and no gravity")
        kept = values > SMALLEST**2 * values[0]
        self.singular_values = np.sqrt(values[kept])
        columns = weighted.T @ (vectors[:, kept] / self.singular_values)
        columns, triangle = np.linalg.qr(columns)  # the small ones are not quite orthogonal
        columns *= np.sign(np.diag(triangle))
        self.modes = (columns.reshape(len(node_mass), 3, -1)) / root[:, :, None]
        self.amplitudes = weighted @ columns

    @property
    def largest(self) -> float:
        """Largest displacement of a node in the training [mm]."""
        return float(np.linalg.norm(self._displacements, axis=2).max())

    def error(self, count: int) -> float:
        """Largest error of a node [mm] where `count` modes stand for the displacements of the training."""
        flat = self.modes[:, :, :count].reshape(-1, count)
        worst = 0.0
        for displacement, amplitude in zip(self._displacements, self.amplitudes, strict=True):
            missed = displacement - (flat @ amplitude[:count]).reshape(-1, 3)
            worst = max(worst, float(np.linalg.norm(missed, axis=1).max()))
        return worst

    def count_for(self, tolerance: float) -> int:
        """Smallest number of modes whose error is within a share of `tolerance` times the largest displacement."""
        allowed = SHARE * tolerance * self.largest
        low, high = 1, len(self.singular_values)
        while low < high:
            middle = (low + high) // 2
            low, high = (low, middle) if self.error(middle) <= allowed else (middle + 1, high)
        return low


# Elastic forces of single integration domains on the modes, in numpy, for any element and any law.
#
# With F the deformation gradient of a domain, P its first Piola-Kirchhoff stress and V its volumes for the energies of
# shape and of volume, the work of a domain on mode k is (V_1 P_1 + V_2 P_2) : dF/dq_k. Hooke's law is corotated, P = R
# (2 mu e + lambda tr(e) I) with e = sym(R^T F) - I; rubber has P = J s F^-T with Cauchy's stress s.


class DomainForces:
    """The integration domains of a body in the coordinates of its mesh.

    Attributes:
        modes: shape (node_count, 3, mode_count).
        anchor: stiffness of the anchors on the modes, shape (mode_count, mode_count).
        count: number of domains.
        gradient: dF/dq of each domain and mode, shape (count, 3, 3, mode_count).
        volume: for which the energies of shape and of volume count [mm^3], shape (count, 2).
    """

    def __init__(self, body: "SoftBody", modes: np.ndarray):
        """Take the domains of a body, and modes, shape (node_count, 3, mode_count)."""
        own_material = body.material - body.material.min()
        domains = ELEMENT_KINDS[body.settings.element].domains(body.mesh.nodes, body.elements, own_material)
        self.count, self.volume, self.modes = len(domains.volume), domains.volume, modes
        self.gradient = np.stack([domains.deformation(mode) for mode in np.moveaxis(modes, 2, 0)], axis=3)
        first, second = body.lame[domains.element].T
        self._lame = first, second
        self._young = second * (3.0 * first + 2.0 * second) / (first + second)
        self._ratio = 0.5 * first / (first + second)
        material = own_material[domains.element]
        self._laws = [
            DomainLaw(np.flatnonzero(material == number), settings.law or body.settings.law, settings.coefficients)
            for number, settings in enumerate(body.settings.materials)
        ]
        turn = _placement(body)
        self.anchor = np.einsum("nir,nij,njs->rs", modes, _turned(body.anchor_stiffness, turn), modes)

    def deformation(self, amplitudes: np.ndarray) -> np.ndarray:
        """Deformation gradients, shape (count, 3, 3), at amplitudes, shape (mode_count,)."""
        deformation: np.ndarray = np.eye(3) + self.gradient @ amplitudes
        return deformation

    def rotations(self, amplitudes: np.ndarray) -> np.ndarray:
        """Rotation of each domain, shape (count, 3, 3)."""
        return polar_rotations(self.deformation(amplitudes))

    def forces(self, amplitudes: np.ndarray) -> np.ndarray:
        """Work of each domain on each mode [mN mm / (mm sqrt(kg))], shape (count, mode_count); its sum is -f_r."""
        stress = self._stress(amplitudes).reshape(self.count, 1, 9)
        forces: np.ndarray = (stress @ self.gradient.reshape(self.count, 9, -1))[:, 0]
        return forces

    def _stress(self, amplitudes: np.ndarray) -> np.ndarray:
        """First Piola-Kirchhoff stress times the volumes [mN mm], shape (count, 3, 3)."""
        f = self.deformation(amplitudes)
        stress = np.empty_like(f)
        for domains, law, coefficients in self._laws:
            if not len(domains):
                continue
            own, young, ratio, volume = f[domains], self._young[domains], self._ratio[domains], self.volume[domains]
            if law == "hooke":
                rotation = self.rotations(amplitudes)[domains]
                shape, pressure = hooke_stress_parts(own, rotation, young, ratio)
                to_rest = rotation
            else:
                shape, pressure = rubber_stress_parts(own, law, coefficients, young, ratio)
                to_rest = np.linalg.det(own)[:, None, None] * np.swapaxes(np.linalg.inv(own), 1, 2)
            whole = volume[:, :1, None] * shape + (volume[:, 1] * pressure)[:, None, None] * np.eye(3)
            stress[domains] = whole @ to_rest
        return stress

    def stiffness(self, amplitudes: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
        """Stiffness of domains and anchors on the modes by the moduli at rest, corotated, (mode_count, mode_count).

        Of Hooke's law it is the part of the tangent that is never negative: 2 mu sym(R^T dF) and lambda tr(R^T dF).
        """
        rotation = self.rotations(amplitudes)
        back = np.swapaxes(rotation, 1, 2)
        turned = (back @ self.gradient.reshape(self.count, 3, -1)).reshape(self.gradient.shape)
        symmetric = 0.5 * (turned + np.swapaxes(turned, 1, 2))
        trace = np.einsum("diir->dr", turned)
        first, second = self._lame
        factor = np.ones(self.count) if weights is None else weights
        shape = symmetric * np.sqrt(2.0 * second * self.volume[:, 0] * factor)[:, None, None, None]
        flat = shape.reshape(-1, shape.shape[3])
        volume = trace * np.sqrt(first * self.volume[:, 1] * factor)[:, None]
        stiffness: np.ndarray = flat.T @ flat + volume.T @ volume + self.anchor
        return stiffness

    def spin_forces(self, amplitudes: np.ndarray, spin: np.ndarray) -> np.ndarray:
        """Work of each domain on each mode by damping, over the factor of Rayleigh, where the body spins with its base.

        The damping is that of the stiffness, K v, whose rotations are frozen: dF = W F with the spin W. It is not
        objective, so that a stretched body resists a spin, and domains have to do the same.

        Args:
            amplitudes: of the state, shape (mode_count,).
            spin: angular velocity [rad/s], shape (3,).
        """
        f, rotation = self.deformation(amplitudes), self.rotations(amplitudes)
        local = np.swapaxes(rotation, 1, 2) @ np.cross(spin, np.eye(3)).T @ f
        symmetric = 0.5 * (local + np.swapaxes(local, 1, 2))
        first, second = self._lame
        stress = (2.0 * second * self.volume[:, 0])[:, None, None] * (rotation @ symmetric)
        stress += (first * self.volume[:, 1] * np.trace(local, axis1=1, axis2=2))[:, None, None] * rotation
        forces: np.ndarray = (stress.reshape(self.count, 1, 9) @ self.gradient.reshape(self.count, 9, -1))[:, 0]
        return forces


def _placement(body: "SoftBody") -> np.ndarray:
    turn: np.ndarray = Rotation.from_euler("xyz", body.settings.rotation, degrees=True).as_matrix()
    return turn


def _turned(stiffness: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Springs along the axes of space, (node_count, 3), as matrices in the axes of the mesh, (node_count, 3, 3)."""
    turned: np.ndarray = np.einsum("ki,nk,kj->nij", turn, stiffness, turn)
    return turned


# Few integration domains with weights that move a body as all of them do.
#
# The energy-conserving sampling and weighting of Farhat, Avery, Chapman and Cortial (2014): weights that are not
# negative, found by the non-negative least squares of Lawson and Hanson (1974), which take in one domain after the
# other and end as soon as the error is small enough. What is made small is not the error of the forces but that of the
# motion: the amplitudes by which a force error displaces a body at rest, K_r^-1 (G w - G 1), with K_r the stiffness at
# the state. The least squares make their norm small, which in modes that are orthonormal in the mass is that of the
# displacements weighted with the masses; the search ends when no node is displaced by more than is allowed.

BATCH = 8
"""Domains taken in at a time."""
PROGRESS = 1.0 - 1e-6
"""Share to which the residual has to fall as columns come in."""
SINGULAR = 1e-7
"""Share of the largest pivot below which columns depend on each other."""
SPIN = 3.0
"""Angular velocity of the base [rad/s] that damping forces are taken at."""


@dataclass(frozen=True)
class Cubature:
    """The chosen domains.

    Attributes:
        domain: their numbers, rising, shape (count,).
        weight: factors on their volumes, above 0, shape (count,).
        error: largest error of the displacement by them in the states that they were chosen by [mm].
    """

    domain: np.ndarray
    weight: np.ndarray
    error: float


class MotionCriterion:
    """By how much weighted domains miss the displacements of some states.

    Attributes:
        rows: amplitude by each domain alone, in each state and mode [mm sqrt(kg)], shape (state_count, mode_count,
            count).
        whole: their sums over all domains, shape (state_count, mode_count).
    """

    def __init__(self, forces: DomainForces, states: np.ndarray, spun: np.ndarray, lag: float):
        """Take states of a body.

        Args:
            forces: the body's domains.
            states: amplitudes, shape (state_count, mode_count).
            spun: amplitudes of states that are also taken spinning about each axis, shape (spun_count, mode_count).
            lag: factor of the damping forces [s].
        """
        axes = SPIN * np.eye(3)
        works = chain(
            ((state, forces.forces(state)) for state in states),
            ((state, lag * forces.spin_forces(state, axis)) for state in spun for axis in axes),
        )
        self.rows = np.empty((len(states) + 3 * len(spun), states.shape[1], forces.count), np.float32)
        for number, (state, work) in enumerate(works):
            factor = scipy.linalg.cho_factor(forces.stiffness(state))
            self.rows[number] = scipy.linalg.cho_solve(factor, work.T)
        self.whole = self.rows.sum(axis=2, dtype=np.float64)
        self._modes = forces.modes.reshape(-1, states.shape[1]).T

    def error(self, domain: np.ndarray, weight: np.ndarray) -> float:
        """The largest displacement of a node in any state by what weighted domains miss [mm]."""
        missed = self.rows[:, :, domain] @ weight - self.whole
        moved = (missed @ self._modes).reshape(len(missed), -1, 3)
        return float(np.linalg.norm(moved, axis=2).max())


class DomainSearch:
    """A greedy search for few domains, which can go on to a smaller error."""

    def __init__(self, criterion: MotionCriterion, volume: np.ndarray):
        """Make a criterion small.

        Args:
            criterion: what is made small.
            volume: volumes of all domains for the energies of shape and of volume [mm^3], shape (count, 2).
        """
        flat = criterion.rows.reshape(-1, criterion.rows.shape[2])
        # Two more rows: the domains stand for the whole volume, so that states unlike all of these are not too soft.
        whole = float(np.sqrt((criterion.whole**2).mean())) / np.maximum(volume.sum(axis=0), 1e-300)[:, None]
        rows = np.vstack([flat, (whole * volume.T)[volume.any(axis=0)]]).astype(np.float32)
        self._criterion, self._search = criterion, NonNegativeSearch(rows)
        self._batch, self._residual, self._error = BATCH, math.inf, math.inf

    def until(self, allowed: float) -> Cubature:
        """The fewest domains that are found whose largest error is at most `allowed` [mm]."""
        search, goes_on = self._search, True
        while goes_on and self._error > allowed:
            grows = search.grow(self._batch)
            self._error = self._criterion.error(search.chosen, search.weight)
            # Of several columns that come in together each may push the others out again; a single one cannot.
            stalled = search.residual > PROGRESS * self._residual
            goes_on = grows and not (stalled and self._batch == 1)
            self._batch, self._residual = 1 if stalled else BATCH, search.residual
        order = np.argsort(search.chosen)
        return Cubature(search.chosen[order], search.weight[order], self._error)


class NonNegativeSearch:
    """The least squares of weights that are not negative, over columns that come in one after the other.

    Attributes:
        chosen: numbers of the columns, shape (count,).
        weight: their weights, above 0, shape (count,).
    """

    def __init__(self, rows: np.ndarray):
        """Seek weights by which columns of `rows`, shape (row_count, column_count), add up to the sum of all."""
        self._rows = rows
        self._target = rows.sum(axis=1, dtype=np.float64)
        self._products, self._right = np.zeros((0, 0)), np.zeros(0)
        self.chosen, self.weight = np.zeros(0, int), np.zeros(0)

    @property
    def residual(self) -> float:
        """Root of the sum of squares that is left."""
        return float(np.linalg.norm(self._target - self._rows[:, self.chosen] @ self.weight))

    def grow(self, count: int) -> bool:
        """Take in the columns that reduce the residual most, at most `count`; False where none does."""
        missed = self._target - self._rows[:, self.chosen] @ self.weight
        gain = missed.astype(np.float32) @ self._rows
        gain[self.chosen] = -np.inf
        add = np.argsort(gain)[-count:]
        add = add[gain[add] > 0.0]
        new = self._rows[:, add].astype(np.float64)
        cross = self._rows[:, self.chosen].T.astype(np.float64) @ new
        self._products = np.block([[self._products, cross], [cross.T, new.T @ new]])
        self._right = np.concatenate([self._right, new.T @ self._target])
        self.chosen = np.concatenate([self.chosen, add])
        self._solve(np.concatenate([self.weight, np.zeros(len(add))]))
        return bool(len(add))

    def _solve(self, weight: np.ndarray) -> None:
        """The least squares over the chosen columns, from weights that are not negative; drops the others."""
        kept = np.arange(len(self.chosen))
        while True:
            solution = _solve_positive(self._products[np.ix_(kept, kept)], self._right[kept])
            if (solution > 0.0).all():
                self.chosen, self.weight = self.chosen[kept], solution
                self._products, self._right = self._products[np.ix_(kept, kept)], self._right[kept]
                return
            falling = solution <= 0.0
            fall = np.where(falling, weight - solution, 1.0)
            share = np.where(falling, weight / np.where(fall > 0.0, fall, 1.0), np.inf)
            step = float(share.min())
            stays = share > step
            weight, kept = (weight + step * (solution - weight))[stays], kept[stays]


def _solve_positive(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    try:
        factor = scipy.linalg.cho_factor(matrix)
        pivots = np.abs(np.diag(factor[0]))
        independent = bool(pivots.min() > SINGULAR * pivots.max())
    except np.linalg.LinAlgError:
        independent = False
    solution: np.ndarray = (
        scipy.linalg.cho_solve(factor, right) if independent else scipy.linalg.lstsq(matrix, right)[0]
    )
    return solution


STATES, PERTURBED, SPUN = 110, 40, 20
"""States of the training that the domains are chosen by, and states beside them, so that stiffness counts too,
and states that are also taken spinning."""
PERTURBATION = 0.2
"""How far those are from states of the training, as a share of the amplitudes' standard deviations."""
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
        spread = amplitudes[far_apart(amplitudes, STATES)]
        beside = spread[np.linspace(0, len(spread) - 1, min(PERTURBED, len(spread))).astype(int)]
        noise = np.random.default_rng(SEED).standard_normal(beside.shape)
        return np.vstack([spread, beside + PERTURBATION * amplitudes.std(axis=0) * noise])

    def use_modes(self, count: int) -> None:
        """Use so many modes, or all that the training shows; before `choose`."""
        self.mode_count = min(count, len(self.basis.singular_values))

    @cached_property
    def _search(self) -> DomainSearch:
        states = self._states()
        forces = DomainForces(self._body, self.basis.modes[:, :, : self.mode_count])
        criterion = MotionCriterion(forces, states, states[:SPUN], self._lag)
        return DomainSearch(criterion, self._body.mesh_domains.volume)

    def choose(self, part: float = 1.0) -> None:
        """Choose domains whose error is within a `part` of their share of the tolerance."""
        allowed = part * SHARE * self._tolerance * self.basis.largest
        self.cubature = self._search.until(allowed)

    def write(self, path: Path, **validated: Any) -> None:
        """Write the file of the shape, with what the validation found; modes in single precision."""
        amplitudes = self.basis.amplitudes[:, : self.mode_count]
        Modes(
            rest_position=self._body.mesh.nodes,
            modes=self.basis.modes[:, :, : self.mode_count].astype(np.float32),
            domain=None if self.cubature is None else self.cubature.domain,
            weight=None if self.cubature is None else self.cubature.weight,
            amplitude_range=np.column_stack([amplitudes.min(axis=0), amplitudes.max(axis=0)]),
            fingerprint=self._body.fingerprint,
            tolerance=self._tolerance,
            **validated,
        ).write(path)


def displacements_of(shape: BodyShape, results: Sequence[RunResult]) -> list[np.ndarray]:
    """The displacements of all copies in runs that came to their end [mm], each of shape (count, node_count, 3)."""
    completed = [result.displacement for result in results if not result.problem]
    return [
        displacement[name].astype(np.float64)
        for displacement in completed
        for name in shape.bodies
        if name in displacement
    ]


def far_apart(points: np.ndarray, count: int) -> np.ndarray:
    """Numbers of points, shape (point_count, dimension), each as far as possible from those before it, (count,)."""
    chosen = [int(np.linalg.norm(points, axis=1).argmax())]
    distance = np.full(len(points), np.inf)
    while len(chosen) < min(count, len(points)):
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
        chosen.append(int(distance.argmax()))
    return np.array(chosen)
