"""Stress of smoothed and of quadratic elements, from the domains in which the engine integrates their energies.

A tetrahedron's own corners tell the volume of nearly incompressible rubber so badly that its pressure would be off by a
thousand times: the engine holds the volume around the nodes (smoothed) or in the mean of an element (quadratic), while
single tetrahedra may change theirs. So the stress of shape comes from the domains of an element around its edges or at
its quadrature points, and the pressure from the domains around its nodes, or the mean of its points.
"""

from collections.abc import Sequence

import numpy as np

from taichisoft.bodies import ELEMENT_KINDS
from taichisoft_outputs.law_stress import (
    DomainLaw,
    add_pressure,
    hooke_stress_parts,
    polar_rotations,
    rubber_stress_parts,
)


class DomainStress:
    """The stress of a body of smoothed or quadratic elements, in many frames."""

    def __init__(
        self,
        kind: str,
        rest_position: np.ndarray,
        elements: np.ndarray,
        material: np.ndarray,
        poisson_ratio: np.ndarray,
        laws: Sequence[DomainLaw],
    ):
        """Compute what does not change with positions and stiffness.

        Args:
            kind: kind of the elements, a name in ELEMENT_KINDS.
            rest_position: nodes at rest [mm], shape (node_count, 3).
            elements: node indices, shape (element_count, nodes_per_element).
            material: number of the material of each element, shape (element_count,).
            poisson_ratio: Poisson's ratio of each element, shape (element_count,).
            laws: every element is in one.
        """
        self._count = len(elements)
        self._domains = ELEMENT_KINDS[kind].domains(rest_position, elements, material)
        self._shape, self._volume = ELEMENT_KINDS[kind].stress_domains(elements, len(rest_position), material)
        self._poisson_ratio = poisson_ratio[self._domains.element]
        law_of_element = np.empty(self._count, dtype=int)
        for number, one in enumerate(laws):
            law_of_element[one.elements] = number
        law_of_domain = law_of_element[self._domains.element]
        self._laws = [(np.flatnonzero(law_of_domain == number), one) for number, one in enumerate(laws)]

    def stress(self, position: np.ndarray, young_modulus: np.ndarray) -> np.ndarray:
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
        for some, (_, law, coefficients) in self._laws:
            f, young, ratio = deformation[some], modulus[some], self._poisson_ratio[some]
            if law == "hooke":
                shape[some], volume[some] = hooke_stress_parts(f, polar_rotations(f), young, ratio)
            else:
                shape[some], volume[some] = rubber_stress_parts(f, law, coefficients, young, ratio)
        stress = shape[self._shape].mean(axis=-3).reshape(-1, 3, 3)
        return add_pressure(stress, np.repeat(volume[self._volume].mean(axis=1), len(stress) // self._count))
