"""Stress of soft bodies from the positions of their nodes, by the law with which the engine moves them.

With F the deformation gradient of an element, R its rotation and e = sym(R^T F) - I its strain,
    s = R (lambda tr(e) I + 2 mu e) R^T,
which is Hooke's law in the element's own axes, turned to the world's axes. The nodal forces of the engine are
f_a = -w s R g_a, with w the element's volume at rest and g_a the gradients of its shape functions. Linear elements of
rubber have Cauchy's, smoothed and quadratic ones that of their domains.

Positions are in mm, of shape (node_count, 3), elements node indices (element_count, nodes_per_element); deformation
gradients have the shape (count, 3, 3), and Young's moduli [kPa] and Poisson's ratios are those of each element.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taichisoft.base import edge_frames
from taichisoft.errors import TaichisoftError
from taichisoft.mechanics import ELEMENT_KINDS, linear_tetrahedra
from taichisoft.runtime import RUBBER_LAWS
from taichisoft.scene import Law, lame_parameters

if TYPE_CHECKING:
    from taichisoft_outputs.recording.bodies import RecordedSoftBody
    from taichisoft_outputs.recording.reader import Recording

# Stress by the laws of elasticity in numpy, since a recording is drawn without kernels.


class DomainLaw(NamedTuple):
    """The law of some elements.

    Attributes:
        coefficients: coefficients of a law of rubber; None for a law given by Young's modulus alone.
    """

    elements: np.ndarray
    law: Law
    coefficients: Mapping[str, float] | None


def polar_rotations(deformation: np.ndarray) -> np.ndarray:
    """The rotation nearest to each deformation gradient, never a reflection: an inverted element keeps a rotation."""
    left, _, right = np.linalg.svd(deformation)
    left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    return left @ right


def hooke_stress_parts(
    deformation: np.ndarray, rotation: np.ndarray, young_modulus: np.ndarray, poisson_ratio: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Corotational stress of Hooke's law.

    Args:
        rotation: rotations in whose axes the strain is small, shape (count, 3, 3).

    Returns:
        As `rubber_stress_parts`: 2 mu e in the axes of the world, and lambda tr(e).
    """
    back = np.swapaxes(rotation, 1, 2)
    stretch = back @ deformation
    strain = 0.5 * (stretch + np.swapaxes(stretch, 1, 2)) - np.eye(3)
    first, second = lame_parameters(young_modulus, poisson_ratio).T
    return 2.0 * second[:, None, None] * (rotation @ strain @ back), first * np.trace(strain, axis1=1, axis2=2)


def rubber_stress_parts(
    deformation: np.ndarray,
    law: Law,
    coefficients: Mapping[str, float] | None,
    young_modulus: np.ndarray,
    poisson_ratio: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Cauchy's stress, force over present area, of the energies of shape and of volume.

    Args:
        law: a law of rubber.
        coefficients: coefficients of the law, which are scaled to `young_modulus` at rest.
        young_modulus: present Young's modulus at rest [kPa], shape (count,).
        poisson_ratio: Poisson's ratio at rest, shape (count,).

    Returns:
        Stress [kPa] of the energy of shape, positive in tension, in the axes of the world, shape (count, 3, 3), and
        of the energy of volume, lambda (J - 1) in all directions, shape (count,).
    """
    rubber = RUBBER_LAWS[law]
    given = coefficients or rubber.of_shear_modulus(1.0)
    left, stretches, _ = np.linalg.svd(deformation)
    volume = np.linalg.det(deformation)
    stretches[:, 2] *= np.sign(volume)
    first, second = lame_parameters(young_modulus, poisson_ratio).T
    stress = (second / rubber.shear_modulus(given))[:, None] * rubber.principal_stress(given, stretches)
    return np.einsum("eik,ek,ejk->eij", left, stress, left), first * (volume - 1.0)


def add_pressure(shape: np.ndarray, volume: np.ndarray) -> np.ndarray:
    """Stress [kPa], shape (count, 3, 3), of its parts by shape and by volume, (count, 3, 3) and (count,)."""
    return shape + volume[:, None, None] * np.eye(3)


# Stress of smoothed and of quadratic elements, from the domains in which the engine integrates their energies.
#
# A tetrahedron's own corners tell the volume of nearly incompressible rubber so badly that its pressure would be off by
# a thousand times: the engine holds the volume around the nodes (smoothed) or in the mean of an element (quadratic),
# while single tetrahedra may change theirs. So the stress of shape comes from the domains of an element around its
# edges or at its quadrature points, and the pressure from the domains around its nodes, or the mean of its points.


class DomainStress:
    """The stress of a body of smoothed or quadratic elements, in many instants.

    Attributes:
        domains: the domains in which the engine integrates its energies.
    """

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
            material: number of the material of each element, shape (element_count,).
            laws: every element is in one.
        """
        self._count = len(elements)
        self.domains = ELEMENT_KINDS[kind].domains(rest_position, elements, material)
        self._shape, self._volume = ELEMENT_KINDS[kind].stress_domains(elements, len(rest_position), material)
        self._poisson_ratio = poisson_ratio[self.domains.element]
        law_of_element = np.empty(self._count, dtype=int)
        for number, one in enumerate(laws):
            law_of_element[one.elements] = number
        law_of_domain = law_of_element[self.domains.element]
        self._laws = [(np.flatnonzero(law_of_domain == number), one) for number, one in enumerate(laws)]

    def stress(self, position: np.ndarray, young_modulus: np.ndarray) -> np.ndarray:
        """Cauchy's stress of rubber, or the corotational one of Hooke's law, in the axes of the world.

        Returns:
            Stress [kPa], positive in tension, of each element, and of each of the eight parts of a quadratic one, in
            order, shape (count, 3, 3).
        """
        shape, volume = self.at_domains(position, young_modulus)
        stress = shape[self._shape].mean(axis=-3).reshape(-1, 3, 3)
        return add_pressure(stress, np.repeat(volume[self._volume].mean(axis=1), len(stress) // self._count))

    def at_domains(self, position: np.ndarray, young_modulus: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Stress [kPa] by the shape of each domain, shape (domain_count, 3, 3), and by its volume, (domain_count,)."""
        deformation, modulus = self.domains.deformation(position), young_modulus[self.domains.element]
        shape, volume = np.empty_like(deformation), np.empty(len(deformation))
        for some, (_, law, coefficients) in self._laws:
            f, young, ratio = deformation[some], modulus[some], self._poisson_ratio[some]
            if law == "hooke":
                shape[some], volume[some] = hooke_stress_parts(f, polar_rotations(f), young, ratio)
            else:
                shape[some], volume[some] = rubber_stress_parts(f, law, coefficients, young, ratio)
        return shape, volume


class StressLaw:
    """The stress of a body of linear tetrahedra, in many instants."""

    def __init__(
        self,
        rest_position: np.ndarray,
        elements: np.ndarray,
        poisson_ratio: np.ndarray,
        corotation: str = "edges",
        laws: Sequence[DomainLaw] = (),
    ):
        """Compute what does not change with positions and stiffness.

        Args:
            corotation: what rotates the elements, as in a scene.
            laws: laws of elements; Hooke's law for all others.
        """
        self._elements = elements
        self._gradients = linear_tetrahedra(rest_position, elements)[0][:, 0]
        self._poisson_ratio = poisson_ratio
        self._corotation = corotation
        self._from_rest_frame = np.swapaxes(_frames(rest_position, elements), 1, 2)
        self._rubbers = [one for one in laws if one.law != "hooke"]

    def stress(self, position: np.ndarray, young_modulus: np.ndarray) -> np.ndarray:
        """Stress of each element, in the axes of the world: corotational by Hooke's law, Cauchy's of rubber.

        Returns:
            Stress [kPa], positive in tension, shape (element_count, 3, 3).
        """
        deformation = np.swapaxes(position[self._elements], 1, 2) @ self._gradients
        if self._corotation == "polar":
            rotation = polar_rotations(deformation)
        elif self._corotation == "edges":
            rotation = _frames(position, self._elements) @ self._from_rest_frame
        else:
            rotation = np.broadcast_to(np.eye(3), deformation.shape)
        stress = add_pressure(*hooke_stress_parts(deformation, rotation, young_modulus, self._poisson_ratio))
        for some, law, coefficients in self._rubbers:
            parts = deformation[some], law, coefficients, young_modulus[some], self._poisson_ratio[some]
            stress[some] = add_pressure(*rubber_stress_parts(*parts))
        return stress


def recorded_stress(recording: "Recording") -> Callable[[int], list[np.ndarray]]:
    """Gives the stresses [kPa] of the `tetrahedra` of each soft body in an instant, each of shape (count, 3, 3)."""
    bodies = [(body, _body_stress(recording, body)) for body in recording.soft_bodies]

    def stresses(instant: int) -> list[np.ndarray]:
        position, young_modulus = recording.row("position", instant), recording.row("young_modulus", instant)
        return [law.stress(position[body.nodes], young_modulus[body.material]) for body, law in bodies]

    return stresses


def _body_stress(
    recording: "Recording", body: "RecordedSoftBody", in_domains: bool = False
) -> StressLaw | DomainStress:
    """The stress of a recorded body, each of whose materials has its own law.

    With `in_domains` linear elements have that of the domains of smoothed ones, which is more even.
    """
    settings = recording.scene.soft_bodies[body.name]
    first = list(recording.scene.young_moduli).index(body.name)
    laws = [
        DomainLaw(np.flatnonzero(body.material == first + number), one.law or settings.law, one.coefficients)
        for number, one in enumerate(settings.materials)
    ]
    kind = settings.element.replace("linear", "smoothed") if in_domains else settings.element
    if kind != "linear":
        return DomainStress(kind, body.rest_position, body.elements, body.material, body.poisson_ratio, laws)
    return StressLaw(body.rest_position, body.elements, body.poisson_ratio, settings.corotation, laws)


def von_mises(stress: np.ndarray) -> np.ndarray:
    """Equivalent stress of a bar in tension [kPa], shape (count,), for stresses [kPa], shape (count, 3, 3)."""
    mean = np.trace(stress, axis1=1, axis2=2) / 3.0
    deviator = stress - mean[:, None, None] * np.eye(3)
    return np.sqrt(1.5 * np.einsum("eij,eij->e", deviator, deviator))


def nodal_mean(values: np.ndarray, elements: np.ndarray, rest_position: np.ndarray) -> np.ndarray:
    """Mean of the elements around each node, weighted with their volumes at rest.

    Args:
        values: values of the elements, shape (element_count,).

    Returns:
        Means in the unit of `values`, shape (node_count,); NaN of a node without elements.
    """
    _, volumes = linear_tetrahedra(rest_position, elements)
    corners, node_count = elements.ravel(), len(rest_position)
    weights = np.repeat(volumes[:, 0], elements.shape[1])
    total = np.bincount(corners, weights * np.repeat(values, elements.shape[1]), node_count)
    whole = np.bincount(corners, weights, node_count)
    return np.divide(total, whole, out=np.full(node_count, np.nan), where=whole > 0.0)


def _frames(position: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """The frame that the first two edges of each element span; from rest to now it turns as the element does."""
    corners = position[elements[:, :3]]
    return edge_frames(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


# Stress along a line: linear in the tetrahedra between nodes, whose stress is that of functions of second order fitted
# to the domains around them (superconvergent patch recovery, Zienkiewicz and Zhu 1992). It reaches up to a surface,
# where the mean of the elements around a node is that of a place further in.

LINE_POINTS = 201
VAGUE = 0.1
"""A fit leaves out what its domains tell so many times worse than what they tell best [-]."""
COMPONENTS = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "yz": (1, 2), "xz": (0, 2)}


@dataclass(frozen=True)
class StressLine:
    """Stress along a straight line through the bodies where they are at rest, and which moves with them.

    Attributes:
        times: [s], shape (instant_count,).
        along: distance from the first end at rest [mm], shape (point_count,).
        stress: in the axes of the world [kPa], positive in tension, NaN outside, (instant_count, point_count, 3, 3).
    """

    times: np.ndarray
    along: np.ndarray
    stress: np.ndarray

    def figures(self) -> dict[str, np.ndarray]:
        """By name, von Mises stress, the largest principal one, and the components, (instant_count, point_count)."""
        principal = np.full(self.stress.shape[:2], np.nan)
        inside = np.isfinite(self.stress[..., 0, 0])
        principal[inside] = np.linalg.eigvalsh(self.stress[inside])[:, -1]
        mises = von_mises(self.stress.reshape(-1, 3, 3)).reshape(principal.shape)
        components = {name: self.stress[..., row, column] for name, (row, column) in COMPONENTS.items()}
        return {"von Mises": mises, "largest principal": principal, **components}


def parse_line(text: str) -> np.ndarray:
    """The ends of a line [mm], shape (2, 3), from "0,0,0:0,0,12.5".

    Raises:
        TaichisoftError: it is no such line.
    """
    try:
        ends = np.array([[float(part) for part in point.split(",")] for point in text.split(":")])
    except ValueError:
        ends = np.zeros(0)
    if ends.shape != (2, 3) or not np.isfinite(ends).all() or (ends[0] == ends[1]).all():
        raise TaichisoftError(f"--line {text}: must be two different points in mm, as 0,0,0:0,0,12.5")
    return ends


def stress_along(recording: "Recording", ends: np.ndarray, instants: Sequence[int]) -> StressLine:
    """The stress along the line between two ends [mm], shape (2, 3), through the bodies where they are at rest.

    Raises:
        TaichisoftError: the line meets no soft body.
    """
    points = np.linspace(ends[0], ends[1], LINE_POINTS)
    stress = np.full((len(instants), LINE_POINTS, 3, 3), np.nan)
    for body in recording.soft_bodies:
        law, parts = _body_stress(recording, body, in_domains=True), []
        assert isinstance(law, DomainStress)
        for instant in instants:
            position, young_modulus = recording.row("position", instant), recording.row("young_modulus", instant)
            parts.append(law.at_domains(position[body.nodes], young_modulus[body.material]))
        at_points = _recovered(body, law, [np.array(part) for part in zip(*parts, strict=True)], points)
        stress = np.where(np.isnan(at_points), stress, at_points)
    if np.isnan(stress).all():
        rest = np.vstack([np.zeros((1, 3)), *(body.rest_position for body in recording.soft_bodies)])[1:]
        places = f"between {_text(rest.min(axis=0))} and {_text(rest.max(axis=0))}" if len(rest) else "none"
        raise TaichisoftError(
            f"--line: none of its {LINE_POINTS} points is in a soft body at rest; they are {places} [mm]"
        )
    return StressLine(recording.times[list(instants)], np.linalg.norm(points - ends[0], axis=1), stress)


def _text(place: np.ndarray) -> str:
    return ",".join(f"{value:.4g}" for value in place)


def _recovered(
    body: "RecordedSoftBody", law: DomainStress, parts: Sequence[np.ndarray], points: np.ndarray
) -> np.ndarray:
    """The stress [kPa] at points (count, 3), NaN outside, shape (instant_count, count, 3, 3).

    Args:
        parts: stress by shape and by volume of all domains in each instant, see `DomainStress.at_domains`.
    """
    from scipy.sparse import csr_matrix

    rest, tetrahedra, domains = body.rest_position, body.tetrahedra, law.domains
    nodes_of = csr_matrix((np.ones(len(domains.node)), domains.node, domains.start), (len(domains.element), len(rest)))
    domains_of, places = nodes_of.T.tocsr(), domains.centres(rest)
    gradients, middles = linear_tetrahedra(rest, tetrahedra)[0][:, 0], rest[tetrahedra].mean(axis=1)

    @cache
    def at_node(node: int, material: int) -> np.ndarray:
        nodes, fitted = np.array([node]), []
        for _ in range(2):  # the domains at the node, and those that share a node with them
            near = np.unique(domains_of[nodes].indices)
            near = near[body.material[domains.element[near]] == material]
            nodes = nodes_of[near].indices
        for values, volume in zip(parts, domains.volume.T, strict=True):
            used = near[volume[near] > 0.0]
            fitted.append(np.tensordot(values[:, used], _fit(places[used], volume[used], rest[node]), (1, 0)))
        return add_pressure(*fitted)

    result = np.full((len(parts[0]), len(points), 3, 3), np.nan)
    for number, point in enumerate(points):
        shares = 0.25 + np.einsum("eai,ei->ea", gradients, point - middles)
        host = int(shares.min(axis=1).argmax())
        if shares[host].min() > -1e-6:
            material = int(body.material[host // body.parts])
            corners = [at_node(node, material) for node in tetrahedra[host].tolist()]
            result[:, number] = np.tensordot(shares[host], corners, 1)
    return result


def _fit(places: np.ndarray, volumes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Weights of values at places (count, 3) in the function of second order that fits them best, at a place (3,)."""
    share = volumes / volumes.sum()
    offset = np.vstack([places, at]) - share @ places
    offset /= np.sqrt(share @ (offset[:-1] ** 2).sum(axis=1)) or 1.0
    terms = np.column_stack([offset, *(offset[:, i] * offset[:, j] for i in range(3) for j in range(i + 1))])
    terms -= share @ terms[:-1]
    root = np.sqrt(share)
    weights: np.ndarray = share + terms[-1] @ (np.linalg.pinv(root[:, None] * terms[:-1], rcond=VAGUE) * root)
    return weights
