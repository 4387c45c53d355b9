"""Elastic forces of single integration domains on the modes, in numpy, for any element and any law.

With F the deformation gradient of a domain, P its first Piola-Kirchhoff stress and V its volumes for the energies of
shape and of volume, the work of a domain on mode k is (V_1 P_1 + V_2 P_2) : dF/dq_k. Hooke's law is corotated,
P = R (2 mu e + lambda tr(e) I) with e = sym(R^T F) - I; rubber has P = J s F^-T with Cauchy's stress s.
"""

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from taichisoft.bodies import ELEMENT_KINDS
from taichisoft_outputs.law_stress import DomainLaw, hooke_stress_parts, polar_rotations, rubber_stress_parts

if TYPE_CHECKING:
    from taichisoft.bodies import SoftBody


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
        self.gradient = np.stack([domains.deformation(one) for one in np.moveaxis(modes, 2, 0)], axis=3)
        first, second = body.lame[domains.element].T
        self._lame = first, second
        self._young = second * (3.0 * first + 2.0 * second) / (first + second)
        self._ratio = 0.5 * first / (first + second)
        material = own_material[domains.element]
        self._laws = [
            DomainLaw(np.flatnonzero(material == number), one.law or body.settings.law, one.coefficients)
            for number, one in enumerate(body.settings.materials)
        ]
        turn = _placement(body)
        self.anchor = np.einsum("nir,nij,njs->rs", modes, _turned(body.anchor_stiffness, turn), modes)

    def deformation(self, amplitudes: np.ndarray) -> np.ndarray:
        """Deformation gradients, shape (count, 3, 3), at amplitudes, shape (mode_count,)."""
        found: np.ndarray = np.eye(3) + self.gradient @ amplitudes
        return found

    def rotations(self, amplitudes: np.ndarray) -> np.ndarray:
        """Rotation of each domain, shape (count, 3, 3)."""
        return polar_rotations(self.deformation(amplitudes))

    def forces(self, amplitudes: np.ndarray) -> np.ndarray:
        """Work of each domain on each mode [mN mm / (mm sqrt(kg))], shape (count, mode_count); its sum is -f_r."""
        stress = self._stress(amplitudes).reshape(self.count, 1, 9)
        found: np.ndarray = (stress @ self.gradient.reshape(self.count, 9, -1))[:, 0]
        return found

    def _stress(self, amplitudes: np.ndarray) -> np.ndarray:
        """First Piola-Kirchhoff stress times the volumes [mN mm], shape (count, 3, 3)."""
        f = self.deformation(amplitudes)
        stress = np.empty_like(f)
        for some, law, coefficients in self._laws:
            if not len(some):
                continue
            own, young, ratio, volume = f[some], self._young[some], self._ratio[some], self.volume[some]
            if law == "hooke":
                rotation = self.rotations(amplitudes)[some]
                shape, pressure = hooke_stress_parts(own, rotation, young, ratio)
                to_rest = rotation
            else:
                shape, pressure = rubber_stress_parts(own, law, coefficients, young, ratio)
                to_rest = np.linalg.det(own)[:, None, None] * np.swapaxes(np.linalg.inv(own), 1, 2)
            whole = volume[:, :1, None] * shape + (volume[:, 1] * pressure)[:, None, None] * np.eye(3)
            stress[some] = whole @ to_rest
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
        found: np.ndarray = flat.T @ flat + volume.T @ volume + self.anchor
        return found

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
        found: np.ndarray = (stress.reshape(self.count, 1, 9) @ self.gradient.reshape(self.count, 9, -1))[:, 0]
        return found


def _placement(body: "SoftBody") -> np.ndarray:
    turn: np.ndarray = Rotation.from_euler("xyz", body.settings.rotation, degrees=True).as_matrix()
    return turn


def _turned(stiffness: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Springs along the axes of space, (node_count, 3), as matrices in the axes of the mesh, (node_count, 3, 3)."""
    found: np.ndarray = np.einsum("ki,nk,kj->nij", turn, stiffness, turn)
    return found
