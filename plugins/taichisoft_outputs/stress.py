"""Stress of soft bodies from the positions of their nodes, by the law with which the engine moves them.

With F the deformation gradient of an element, R its rotation and e = sym(R^T F) - I its strain,
    s = R (lambda tr(e) I + 2 mu e) R^T,
which is Hooke's law in the element's own axes, turned to the world's axes. The nodal forces of the engine are
f_a = -w s R g_a, with w the element's volume at rest and g_a the gradients of its shape functions. Linear elements of
rubber have Cauchy's (`law_stress.py`), smoothed and quadratic ones that of their domains (`domain_stress.py`).
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from taichisoft.bodies import edge_frames, linear_tetrahedra
from taichisoft_outputs.domain_stress import DomainStress
from taichisoft_outputs.law_stress import (
    DomainLaw,
    add_pressure,
    hooke_stress_parts,
    polar_rotations,
    rubber_stress_parts,
)

if TYPE_CHECKING:
    from taichisoft_outputs.recording.bodies import RecordedSoftBody
    from taichisoft_outputs.recording.reader import Recording


class StressLaw:
    """The stress of a body of linear tetrahedra, in many frames."""

    def __init__(
        self,
        rest_position: np.ndarray,
        elements: np.ndarray,
        poisson_ratio: np.ndarray,
        polar: bool = False,
        laws: Sequence[DomainLaw] = (),
    ):
        """Compute what does not change with positions and stiffness.

        Args:
            rest_position: nodes at rest [mm], shape (node_count, 3).
            elements: node indices, shape (element_count, 4).
            poisson_ratio: Poisson's ratio of each element, shape (element_count,).
            polar: whether rotations come from the polar decomposition (`corotation = "polar"` in a scene) and not from
                the first two edges.
            laws: laws of elements; Hooke's law for all others.
        """
        self._elements = elements
        self._gradients = linear_tetrahedra(rest_position, elements)[0][:, 0]
        self._poisson_ratio = poisson_ratio
        self._from_rest_frame = None if polar else np.swapaxes(_frames(rest_position, elements), 1, 2)
        self._rubbers = [one for one in laws if one.law != "hooke"]

    def stress(self, position: np.ndarray, young_modulus: np.ndarray) -> np.ndarray:
        """Stress of each element, in the axes of the world: corotational by Hooke's law, Cauchy's of rubber.

        Args:
            position: nodes [mm], shape (node_count, 3).
            young_modulus: Young's modulus of each element [kPa], shape (element_count,).

        Returns:
            Stress [kPa], positive in tension, shape (element_count, 3, 3).
        """
        deformation = np.swapaxes(position[self._elements], 1, 2) @ self._gradients
        if self._from_rest_frame is None:
            rotation = polar_rotations(deformation)
        else:
            rotation = _frames(position, self._elements) @ self._from_rest_frame
        stress = add_pressure(*hooke_stress_parts(deformation, rotation, young_modulus, self._poisson_ratio))
        for some, law, coefficients in self._rubbers:
            parts = deformation[some], law, coefficients, young_modulus[some], self._poisson_ratio[some]
            stress[some] = add_pressure(*rubber_stress_parts(*parts))
        return stress


def recorded_stress(recording: "Recording") -> Callable[[int], list[np.ndarray]]:
    """Gives the stresses [kPa] of the `tetrahedra` of each soft body in a frame, each of shape (count, 3, 3)."""
    bodies = [(body, _body_stress(recording, body)) for body in recording.soft_bodies]

    def stresses(frame: int) -> list[np.ndarray]:
        position, young_modulus = recording.row("position", frame), recording.row("young_modulus", frame)
        return [law.stress(position[body.nodes], young_modulus[body.material]) for body, law in bodies]

    return stresses


def _body_stress(recording: "Recording", body: "RecordedSoftBody") -> StressLaw | DomainStress:
    """The stress of a recorded body, each of whose materials has its own law."""
    settings = recording.scene.soft_bodies[body.name]
    first = list(recording.scene.young_moduli).index(body.name)
    laws = [
        DomainLaw(np.flatnonzero(body.material == first + number), one.law or settings.law, one.coefficients)
        for number, one in enumerate(settings.materials)
    ]
    if settings.element != "linear":
        return DomainStress(
            settings.element, body.rest_position, body.elements, body.material, body.poisson_ratio, laws
        )
    return StressLaw(body.rest_position, body.elements, body.poisson_ratio, settings.corotation == "polar", laws)


def von_mises(stress: np.ndarray) -> np.ndarray:
    """Equivalent stress of a bar in tension [kPa], shape (count,), for stresses [kPa], shape (count, 3, 3)."""
    mean = np.trace(stress, axis1=1, axis2=2) / 3.0
    deviator = stress - mean[:, None, None] * np.eye(3)
    return np.sqrt(1.5 * np.einsum("eij,eij->e", deviator, deviator))


def nodal_mean(values: np.ndarray, elements: np.ndarray, rest_position: np.ndarray) -> np.ndarray:
    """Mean of the elements around each node, weighted with their volumes at rest.

    Args:
        values: values of the elements, shape (element_count,).
        elements: node indices, shape (element_count, 4); every node belongs to one.
        rest_position: nodes at rest [mm], shape (node_count, 3).

    Returns:
        Means in the unit of `values`, shape (node_count,).
    """
    _, volumes = linear_tetrahedra(rest_position, elements)
    corners, node_count = elements.ravel(), len(rest_position)
    weights = np.repeat(volumes[:, 0], elements.shape[1])
    total = np.bincount(corners, weights * np.repeat(values, elements.shape[1]), node_count)
    return total / np.bincount(corners, weights, node_count)


def _frames(position: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """The frame that the first two edges of each element span; from rest to now it turns as the element does."""
    corners = position[elements[:, :3]]
    return edge_frames(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
