"""The arrays of a soft body: placed nodes, elements, materials, masses, anchors, surfaces and cavities."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from taichisoft.base.rotations import rotation_from_degrees
from taichisoft.errors import MeshError
from taichisoft.mechanics.domains import IntegrationDomains
from taichisoft.mechanics.elastic_laws import ElasticLaws, elastic_law
from taichisoft.mechanics.element_kinds import ELEMENT_KINDS, hexahedral_masses, of_hexahedra
from taichisoft.mechanics.kernels.domain_deformation import HOOKE, LAW_NUMBERS
from taichisoft.mechanics.modes import Modes, check_modes, read_modes
from taichisoft.mechanics.reinforcements import (
    ReinforcementKind,
    Reinforcements,
    fibre_tubes,
    make_reinforcements,
    membrane_slab,
)
from taichisoft.mechanics.selection import (
    SMALLEST_WEIGHT,
    anchor_frames,
    anchor_stiffness,
    embed,
    far_outside,
    nodal_forces,
    select_elements,
    select_nodes,
    surface_group,
)
from taichisoft.mesh.mesh_files import read_surface
from taichisoft.mesh.surface import (
    MappedSurface,
    closed_outward,
    count_open_edges,
    curved_walls,
    enclosed_volume,
    enclosed_volume_of_walls,
    joined_pieces,
)
from taichisoft.mesh.volume_mesh import (
    VolumeMesh,
    boundary_triangles,
    element_volumes,
    hexahedra_of,
    linear_parts,
    with_middle_nodes,
)
from taichisoft.scene import soft_body as settings
from taichisoft.scene.actuators import CavitySettings


@dataclass(frozen=True)
class Cavity:
    """An air chamber.

    Attributes:
        name: "body.cavity".
        surface: closed surface, facing from the air into the silicone, over the body's own nodes.
        walls: where the pressure acts: the same, or around quadratic elements its six-node triangles, shape (count, 6).
        rest_volume: [mm^3].
    """

    name: str
    surface: MappedSurface
    walls: MappedSurface
    rest_volume: float


@dataclass(frozen=True)
class CollisionSurface:
    """A surface that touches others.

    Attributes:
        surface: over the body's own nodes.
        groups: surfaces that have one in common do not touch each other.
    """

    surface: MappedSurface
    groups: frozenset[int] = frozenset()


@dataclass(frozen=True)
class SoftBody:
    """Arrays of one soft body; node indices count within the body.

    Attributes:
        name: the body's name in the scene.
        settings: its table in the scene.
        mesh: the mesh of the body, with the middle nodes of quadratic elements, not placed yet.
        nodes: the range of its nodes in the arrays of the model.
        rest_position: placed nodes [mm], shape (node_count, 3).
        elements: shape (element_count, 4), or (element_count, 10) of quadratic elements.
        lame: Lame's lambda and mu [kPa] of each element at the start of a run, shape (element_count, 2).
        laws: law of each element.
        material: number of the material of each element among the materials of the model, shape (element_count,).
        domains: its integration domains; None where they are linear tetrahedra under Hooke's law.
        node_mass: [kg], shape (node_count,).
        anchor_stiffness: [mN/mm] of the spring at each node along x, y and z, 0 where there is none, (node_count, 3).
        anchor_frame: name of the frame that each anchored node moves with, "" of others, shape (node_count,).
        node_force: constant force on each node [mN], shape (node_count, 3).
        tip_nodes: nodes that the scene's `tip` selects, or None.
        collision_surfaces: what touches other bodies, and each other where they have no group in common.
        cavities: the air chambers.
        modes: by whose amplitudes a reduced body moves, else None.
        reinforcements: its membranes, fibres and springs; None without any.
    """

    name: str
    settings: settings.SoftBodySettings
    mesh: VolumeMesh
    nodes: slice
    rest_position: np.ndarray
    elements: np.ndarray
    lame: np.ndarray
    laws: ElasticLaws
    material: np.ndarray
    domains: IntegrationDomains | None
    node_mass: np.ndarray
    anchor_stiffness: np.ndarray
    anchor_frame: np.ndarray
    node_force: np.ndarray
    tip_nodes: np.ndarray | None
    collision_surfaces: tuple[CollisionSurface, ...]
    cavities: tuple[Cavity, ...]
    modes: Modes | None = None
    reinforcements: Reinforcements | None = None

    @cached_property
    def anchored(self) -> np.ndarray:
        """Whether each node is held along any direction, shape (node_count,)."""
        return np.asarray(self.anchor_stiffness.any(axis=1))

    @cached_property
    def surface(self) -> MappedSurface:
        """All collision surfaces as one: the visible surface of the body."""
        return MappedSurface.joined([one.surface for one in self.collision_surfaces])

    @cached_property
    def reinforcement_surfaces(self) -> list[tuple[str, ReinforcementKind, MappedSurface]]:
        """Name, kind and surface, over the body's own nodes, of each membrane and fibre, for pictures."""
        surfaces: list[tuple[str, ReinforcementKind, MappedSurface]] = []
        for name, membrane in self.settings.membranes.items():
            surfaces.append((f"{self.name}.{name}|membrane", "membrane", membrane_slab(self.mesh, membrane, name)))
        for name, fibre in self.settings.fibres.items():
            tubes = fibre_tubes(self.mesh, fibre.lines(), fibre.diameter)
            surfaces.append((f"{self.name}.{name}|fibre", "fibre", tubes))
        return surfaces

    @property
    def mesh_domains(self) -> IntegrationDomains:
        """All integration domains in the frame of the mesh, also of linear tetrahedra: those that modes choose from."""
        kind = ELEMENT_KINDS[self.settings.element]
        return kind.domains(self.mesh.nodes, self.elements, self.material - self.material.min())

    @cached_property
    def fingerprint(self) -> str:
        """What modes of the body depend on beside its mesh: its element, and laws with moduli as shares of the first.

        Moduli that all change by one factor do not matter to it.
        """
        laws, number = self.laws, self.material - self.material.min()
        texts = []
        for one in np.unique(number):
            first = int(np.argmax(number == one))
            law = next(name for name, code in LAW_NUMBERS.items() if code == laws.kind[first])
            moduli = laws.modulus[first] / laws.lame[0, 1]
            values = [f"{value:.6g}" for value in (*moduli, *laws.pure_number[first])]
            texts.append(f"{law} of {np.count_nonzero(number == one)} elements: {' '.join(values)}")
        return f"{self.settings.element}, " + "; ".join(texts)


def make_soft_body(
    name: str, body: settings.SoftBodySettings, mesh: VolumeMesh, first_node: int, first_material: int
) -> SoftBody:
    """Compute the arrays of a soft body made of `mesh`; its first node and first material have the numbers given
    in the model.
    """
    key = f"soft_bodies.{name}"
    nodes_per_element = len(ELEMENT_KINDS[body.element].mass_shares)
    if nodes_per_element == 10:
        mesh = with_middle_nodes(mesh)
    elif mesh.elements.shape[1] != nodes_per_element:
        raise MeshError(
            f'{mesh.source}: has ten-node tetrahedra, with {key}.element = "{body.element}"; use "quadratic", or mesh '
            "with order = 1"
        )
    if body.element == "hexahedral" and hexahedra_of(mesh.elements) is None:
        raise MeshError(
            f'{mesh.source}: has other cells than hexahedra, with {key}.element = "hexahedral"; use "smoothed", or a '
            "mesh of hexahedra (.msh, .vtk, .vtu)"
        )
    node_count = len(mesh.nodes)
    turn = rotation_from_degrees(body.rotation)
    rest_position = mesh.nodes @ turn.T + np.asarray(body.translation)
    laws, material = _materials(mesh, body, key)
    is_linear = body.element == "linear" and bool((laws.kind == HOOKE).all())
    made = SoftBody(
        name=name,
        settings=body,
        mesh=mesh,
        nodes=slice(first_node, first_node + node_count),
        rest_position=rest_position,
        elements=mesh.elements,
        lame=laws.lame,
        laws=laws,
        material=first_material + material,
        domains=None if is_linear else ELEMENT_KINDS[body.element].domains(rest_position, mesh.elements, material),
        node_mass=_node_masses(mesh, body),
        anchor_stiffness=anchor_stiffness(mesh, body.anchors, f"{key}.anchors"),
        anchor_frame=anchor_frames(mesh, body, f"{key}.anchors"),
        node_force=nodal_forces(mesh, body.forces, f"{key}.forces"),
        tip_nodes=None if body.tip is None else select_nodes(mesh, body.tip, f"{key}.tip"),
        collision_surfaces=_collision_surfaces(mesh, body),
        cavities=tuple(
            _make_cavity(mesh, body, f"{name}.{cavity_name}", cavity, f"{key}.cavities.{cavity_name}")
            for cavity_name, cavity in body.cavities.items()
        ),
        reinforcements=make_reinforcements(mesh, body, key),
    )
    if body.reduced is None:
        return made
    modes = read_modes(Path(body.reduced), f"{key}.reduced")
    check_modes(modes, body.reduced, f"{key}.reduced", made, len(made.mesh_domains.element))
    return replace(made, modes=modes)


def reshaped(body: SoftBody, move: np.ndarray) -> SoftBody:
    """A body whose nodes are elsewhere at rest, by a move [mm], shape (node_count, 3); all selections are as they were.

    Its cavities have the shape that they had.
    """
    mesh = replace(body.mesh, nodes=body.mesh.nodes + move @ rotation_from_degrees(body.settings.rotation))
    rest_position, domains = body.rest_position + move, body.domains
    if domains is not None:
        domains = ELEMENT_KINDS[body.settings.element].domains(rest_position, body.elements, body.material)
    masses = _node_masses(mesh, body.settings)
    return replace(body, mesh=mesh, rest_position=rest_position, domains=domains, node_mass=masses)


def _materials(mesh: VolumeMesh, body: settings.SoftBodySettings, key: str) -> tuple[ElasticLaws, np.ndarray]:
    """The law of each element, and the number of its material: 0 the body's own, from 1 on the regions'."""
    material = np.zeros(len(mesh.elements), dtype=np.int32)
    for index, region in enumerate(body.regions):
        material[select_elements(mesh, region, f"{key}.regions.{index}")] = 1 + index
    if body.element == "hexahedral":
        material = of_hexahedra(material)
    laws = []
    for one in body.materials:
        poisson_ratio = body.poisson_ratio if one.poisson_ratio is None else one.poisson_ratio
        laws.append(elastic_law(one.law or body.law, one.young_modulus, one.coefficients, poisson_ratio))
    return ElasticLaws.joined(laws).select(material), material


def _node_masses(mesh: VolumeMesh, body: settings.SoftBodySettings) -> np.ndarray:
    node_count = len(mesh.nodes)
    if body.mass is not None:
        return np.full(node_count, body.mass / node_count)
    if body.element == "hexahedral":
        return hexahedral_masses(mesh.nodes, mesh.elements, body.density or 0.0)
    part = ELEMENT_KINDS[body.element].mass_shares
    share = (body.density or 0.0) * element_volumes(mesh.nodes, mesh.elements)
    return np.bincount(mesh.elements.ravel(), np.outer(share, part).ravel(), node_count)


def _collision_surfaces(mesh: VolumeMesh, body: settings.SoftBodySettings) -> tuple[CollisionSurface, ...]:
    """The scene's own surfaces, else the group "outer", else the mesh's boundary; without the walls of cavities.

    A boundary that is not closed, such as that of two elements which share an edge alone, is shown as it is where the
    body touches nothing.
    """
    if body.collision_surface:
        return tuple(
            CollisionSurface(_surface_of_file(mesh, one, body), frozenset(one.groups)) for one in body.collision_surface
        )
    source = f"{mesh.source}: outer surface"
    triangles = mesh.surface_groups.get("outer", boundary_triangles(mesh.elements))
    if not body.collides and count_open_edges(triangles):
        return (CollisionSurface(MappedSurface.of_nodes(triangles)),)
    if "outer" in mesh.surface_groups:
        triangles = closed_outward(mesh.nodes, mesh.surface_groups["outer"], source)
    else:
        triangles = _outermost(mesh.nodes, triangles, source)
    return (CollisionSurface(MappedSurface.of_nodes(triangles)),)


def _surface_of_file(
    mesh: VolumeMesh, one: settings.CollisionSurfaceSettings, body: settings.SoftBodySettings
) -> MappedSurface:
    vertices, triangles = read_surface(one.file)
    if one.open and count_open_edges(triangles):
        return _follow(mesh, vertices, triangles, one.file, body)
    used, triangles = np.unique(_outermost(vertices, triangles, one.file), return_inverse=True)
    return _follow(mesh, vertices[used], triangles.reshape(-1, 3), one.file, body)


def _outermost(vertices: np.ndarray, triangles: np.ndarray, source: str) -> np.ndarray:
    """The connected parts of a closed surface that enclose silicone: the walls of cavities have a negative volume."""
    triangles = closed_outward(vertices, triangles, source)
    part = joined_pieces(len(vertices), triangles[:, [0, 1, 1, 2]].reshape(-1, 2))[triangles[:, 0]]
    encloses = {label: enclosed_volume(vertices, triangles[part == label]) > 0.0 for label in set(part)}
    return triangles[[encloses[label] for label in part]]


def _make_cavity(
    mesh: VolumeMesh, body: settings.SoftBodySettings, name: str, cavity: CavitySettings, key: str
) -> Cavity:
    if cavity.surface is not None:
        vertices, triangles = read_surface(cavity.surface)
        triangles = closed_outward(vertices, triangles, cavity.surface)
        surface = _follow(mesh, vertices, triangles, cavity.surface, body)
    else:
        source = f"{mesh.source}: cavity '{cavity.group}'"
        triangles = closed_outward(mesh.nodes, surface_group(mesh, cavity.group or "", key), source)
        surface = MappedSurface.of_nodes(triangles)
        if mesh.elements.shape[1] == 10:
            walls = curved_walls(triangles, mesh.elements)
            return Cavity(name, surface, walls, enclosed_volume_of_walls(walls.positions(mesh.nodes), walls.triangles))
    return Cavity(name, surface, surface, enclosed_volume(surface.positions(mesh.nodes), surface.triangles))


def _follow(
    mesh: VolumeMesh, vertices: np.ndarray, triangles: np.ndarray, source: str, body: settings.SoftBodySettings
) -> MappedSurface:
    """A surface of its own, embedded in the elements as the body's settings say."""
    nodes, weights = embed(vertices, mesh.nodes, linear_parts(mesh.elements), body.embedding)
    outside, box = far_outside(vertices, mesh)
    outside |= weights.min(axis=1) < SMALLEST_WEIGHT
    if outside.any() and body.points_outside == "refused":
        raise MeshError(
            f"{source}: vertex {int(np.argmax(outside))} at {np.round(vertices[outside][0], 3).tolist()} mm lies "
            f"outside the body {mesh.source} ({box}); give the surface of this mesh, in its coordinates, or mesh the "
            "body more finely"
        )
    return MappedSurface(nodes, weights, triangles.astype(np.int32))
