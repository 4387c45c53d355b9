"""Stress of smoothed and of quadratic elements, from the domains in which the engine integrates their energies.

A tetrahedron's own corners tell the volume of nearly incompressible rubber so badly that its pressure would be off by a
thousand times: in the engine it is held around the nodes (smoothed) or in the mean of an element (quadratic), while
single tetrahedra may change theirs. So the stress of shape is that of the domains which an element is a part of, around
its edges or at its quadrature points, and the pressure that of those around its nodes, or the mean of its points.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from taichisoft.bodies.domains import domains_of_elements, quadrature_domains, smoothed_domains
from taichisoft.bodies.elements import QUADRATURE_POINTS, lame_parameters
from taichisoft.scenes.elastic_law import Law
from taichisoft_plugins.rubber_stress import rubber_stress_parts


class DomainLaw(NamedTuple):
    """The law of some elements.

    Attributes:
        elements: their numbers, shape (count,).
        law: its name.
        coefficients: of a law of rubber; None for those given by Young's modulus alone.
    """

    elements: np.ndarray
    law: Law
    coefficients: Mapping[str, float] | None


class DomainStress:
    """The stress of a body of smoothed or quadratic elements, in many frames."""

    def __init__(
        self,
        rest_position: np.ndarray,
        elements: np.ndarray,
        material: np.ndarray,
        poisson_ratio: np.ndarray,
        laws: Sequence[DomainLaw],
    ):
        """Compute what does not change with positions and stiffness.

        Args:
            rest_position: nodes at rest [mm], shape (node_count, 3).
            elements: node indices, shape (element_count, 4) for smoothed ones, (element_count, 10) for quadratic ones.
            material: number of the material of each element, shape (element_count,).
            poisson_ratio: Poisson's ratio of each element, shape (element_count,).
            laws: every element is in one.
        """
        self._count = len(elements)
        if elements.shape[1] == 4:
            self._domains = smoothed_domains(rest_position, elements, material)
            self._shape, self._volume = domains_of_elements(elements, len(rest_position), material)
        else:
            self._domains = quadrature_domains(rest_position, elements)
            points = len(QUADRATURE_POINTS)
            self._volume = np.arange(self._count * points).reshape(-1, points)
            # Of the eight parts of an element each of the first four is at a corner, the others share its middle.
            nearest = self._volume[:, QUADRATURE_POINTS.argmax(axis=0)]
            middle = np.repeat(self._volume[:, None], 4, axis=1)
            self._shape = np.concatenate([np.repeat(nearest[:, :, None], points, axis=2), middle], axis=1)
        self._poisson_ratio = poisson_ratio[self._domains.element]
        law_of_element = np.empty(self._count, dtype=int)
        for number, one in enumerate(laws):
            law_of_element[one.elements] = number
        law_of_domain = law_of_element[self._domains.element]
        self._laws = [(np.flatnonzero(law_of_domain == number), one) for number, one in enumerate(laws)]

    def __call__(self, position: np.ndarray, young_modulus: np.ndarray) -> np.ndarray:
        """Cauchy's stress of rubber, or the corotational one of Hooke's law, in the axes of the world.

        Args:
            position: nodes [mm], shape (node_count, 3).
            young_modulus: Young's modulus of each element [kPa], shape (element_count,).

        Returns:
            Stress [kPa], positive in tension, of each element, and of each of the eight parts of a quadratic one, in
            order, shape (count, 3, 3).
        """
        deformation, modulus = self._domains.deformation(position), young_modulus[self._domains.element]
        shape, volume = np.empty_like(deformation), np.empty(len(deformation))
        for some, law in self._laws:
            given = deformation[some], modulus[some], self._poisson_ratio[some]
            shape[some], volume[some] = _parts(law, *given)
        stress = shape[self._shape].mean(axis=-3).reshape(-1, 3, 3)
        pressure = np.repeat(volume[self._volume].mean(axis=1), len(stress) // self._count)
        return stress + pressure[:, None, None] * np.eye(3)


def _parts(
    law: DomainLaw, deformation: np.ndarray, young_modulus: np.ndarray, poisson_ratio: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Stresses [kPa] of the energies of shape, shape (count, 3, 3), and of volume, in all directions, (count,)."""
    if law.law != "hooke":
        return rubber_stress_parts(deformation, law.law, law.coefficients, young_modulus, poisson_ratio)
    rotation = polar_rotations(deformation)
    stretch = np.swapaxes(rotation, 1, 2) @ deformation
    strain = 0.5 * (stretch + np.swapaxes(stretch, 1, 2)) - np.eye(3)
    first, second = lame_parameters(young_modulus, poisson_ratio).T
    turned = rotation @ strain @ np.swapaxes(rotation, 1, 2)
    return 2.0 * second[:, None, None] * turned, first * np.trace(strain, axis1=1, axis2=2)


def polar_rotations(deformation: np.ndarray) -> np.ndarray:
    """The rotation nearest to each deformation gradient, never a reflection: an inverted element keeps a rotation."""
    left, _, right = np.linalg.svd(deformation)
    left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    return left @ right
