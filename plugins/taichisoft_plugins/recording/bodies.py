"""The part of a recording that does not change during a run, written and read: header, bodies, surfaces, cables."""

import json
import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

import numpy as np

import taichisoft
from taichisoft.bodies.cable_paths import CablePath, cable_paths
from taichisoft.bodies.surfaces import BodySurface, Plane, Surface, soft_surface
from taichisoft.meshes.second_order import linear_parts
from taichisoft.meshes.surface import MappedSurface
from taichisoft.meshes.volume_mesh import VolumeMesh
from taichisoft.scenes.file import scene_to_toml
from taichisoft_plugins.recording.layout import LAYOUT

if TYPE_CHECKING:
    from taichisoft.bodies.soft_body import SoftBody
    from taichisoft.model import Model


PACKAGES = ("taichi", "numpy", "scipy", "h5py")

CABLE_ARRAYS = ("owner", "nodes", "weights", "place")
CABLE_NUMBERS = ("rest_length", "friction", "has_pull_point", "pull_point_moves")
"""Attributes of a `CablePath` that are datasets of its group, and those that are attributes."""


@dataclass(frozen=True)
class RecordedSurface(Surface):
    """A surface in the frames of a recording.

    Attributes:
        vertices: gives the positions of the vertices [mm], shape (vertex_count, 3), in a frame.
        mapping: the map from all soft nodes to the vertices; None for surfaces that keep their shape.
    """

    vertices: Callable[[int], np.ndarray]
    mapping: MappedSurface | None = None


@dataclass(frozen=True)
class RecordedSoftBody:
    """A soft body; node indices count within it.

    Attributes:
        name: name of the body.
        nodes: where its nodes stand in `row("position", frame)` and the other arrays of all nodes.
        rest_position: placed nodes [mm], shape (node_count, 3).
        elements: node indices of each element, shape (element_count, nodes_per_element).
        material: column of each element's material in `row("young_modulus", frame)`, shape (element_count,).
        poisson_ratio: Poisson's ratio of each element, shape (element_count,).
        element_groups: element indices by the group names of the mesh.
        surface_groups: triangles (count, 3) of node indices by the group names of the mesh.
        mesh_nodes: nodes as they were in the mesh, before they were placed [mm], shape (node_count, 3).
    """

    name: str
    nodes: slice
    rest_position: np.ndarray
    elements: np.ndarray
    material: np.ndarray
    poisson_ratio: np.ndarray
    element_groups: dict[str, np.ndarray]
    surface_groups: dict[str, np.ndarray]
    mesh_nodes: np.ndarray

    @property
    def tetrahedra(self) -> np.ndarray:
        """The elements as tetrahedra of four nodes, (count, 4): quadratic ones are `parts` of them each, in order."""
        return linear_parts(self.elements)

    @property
    def parts(self) -> int:
        """How many of `tetrahedra` an element is."""
        return len(self.tetrahedra) // len(self.elements)

    def mesh(self, source: str) -> VolumeMesh:
        """The mesh that the body was made of; errors about it begin with `source`."""
        return VolumeMesh(source, self.mesh_nodes, self.elements, self.surface_groups, self.element_groups)


def write_constants(file: Any, model: "Model", every: int, columns: Mapping[str, Sequence[str]]) -> None:
    """Write everything but frames; until the run has ended its outcome is "unfinished".

    Args:
        file: the open HDF5 file.
        model: the model of the run.
        every: steps from frame to frame.
        columns: names of the columns of quantities by cavity, by cable, by pair of bodies and by material: "cavities",
            "cables", "pairs" and "materials".
    """
    import h5py

    attributes = file.attrs
    attributes["taichisoft_version"] = taichisoft.__version__
    attributes["versions"] = json.dumps(_versions())
    attributes["layout"] = LAYOUT
    attributes["scene"] = scene_to_toml(model.scene)
    attributes["every"] = every
    attributes["gravity"] = np.array(model.scene.gravity, dtype=np.float64)
    attributes["base_pivot"] = model.base_pivot
    attributes["step_size"] = float(model.scene.time.step)
    attributes["outcome"] = "unfinished"
    for kind, names in columns.items():
        file.require_group("steps").attrs.create(kind, names, (len(names),), h5py.string_dtype())
    for index, body in enumerate(model.soft_bodies):
        _write_soft_body(file.create_group(f"soft_bodies/{index}"), body)
    for index, rigid in enumerate(model.rigid_bodies):
        group = file.create_group(f"rigid_bodies/{index}")
        group.attrs["name"] = rigid.name
        group["vertices"], group["triangles"] = rigid.vertices, rigid.triangles
    for index, obstacle in enumerate(model.obstacles):
        group = file.create_group(f"obstacles/{index}")
        group.attrs["name"] = obstacle.name
        if obstacle.vertices is None:
            group.attrs["point"], group.attrs["normal"] = obstacle.point, obstacle.normal
        else:
            group["vertices"], group["triangles"] = obstacle.vertices, obstacle.triangles
    for path in cable_paths(model.cables):
        group = file.create_group(f"cables/{path.number}")
        group.attrs["name"] = path.name
        for name in CABLE_NUMBERS:
            group.attrs[name] = getattr(path, name)
        for name in CABLE_ARRAYS:
            group[name] = getattr(path, name)


def read_soft_bodies(file: Any) -> list[RecordedSoftBody]:
    """The soft bodies in the order of the scene."""
    return [
        RecordedSoftBody(
            name=group.attrs["name"],
            nodes=_nodes(group),
            rest_position=group["rest_position"][:],
            elements=group["elements"][:],
            material=group["material"][:],
            poisson_ratio=group["poisson_ratio"][:],
            element_groups={name: members[:] for name, members in group["element_groups"].items()},
            surface_groups={name: members[:] for name, members in group["surface_groups"].items()},
            mesh_nodes=group["mesh_nodes"][:],
        )
        for group in _numbered(file, "soft_bodies")
    ]


def read_surfaces(file: Any) -> Iterator[BodySurface]:
    """The surfaces in the order of `taichisoft.bodies.surfaces.body_surfaces`."""
    for group in _numbered(file, "soft_bodies"):
        yield soft_surface(group.attrs["name"], "soft", _read_surface(group["surface"]), _nodes(group))
        for cavity in _numbered(group, "cavities"):
            yield soft_surface(cavity.attrs["name"], "cavity", _read_surface(cavity), _nodes(group))
    for index, group in enumerate(_numbered(file, "rigid_bodies")):
        yield BodySurface(group.attrs["name"], "rigid", group["triangles"][:], group["vertices"][:], index)
    for group in _numbered(file, "obstacles"):
        if "vertices" in group:
            yield BodySurface(group.attrs["name"], "obstacle", group["triangles"][:], group["vertices"][:])


def read_planes(file: Any) -> list[Plane]:
    """The infinite obstacles."""
    return [
        Plane(group.attrs["name"], group.attrs["point"], group.attrs["normal"])
        for group in _numbered(file, "obstacles")
        if "point" in group.attrs
    ]


def read_cables(file: Any) -> Iterator[CablePath]:
    """The paths of the cables in the order of the scene."""
    for number, group in enumerate(_numbered(file, "cables")):
        arrays = {name: group[name][:] for name in CABLE_ARRAYS}
        numbers = {name: group.attrs[name].item() for name in CABLE_NUMBERS}
        yield CablePath(group.attrs["name"], number, **arrays, **numbers)


def _versions() -> dict[str, str]:
    """Versions of the programs that compute the run, and the kind of machine."""
    versions = {"taichisoft": taichisoft.__version__, "Python": platform.python_version()}
    for package in PACKAGES:
        with suppress(PackageNotFoundError):
            versions[package] = version(package)
    return {**versions, "machine": f"{platform.system()} {platform.machine()}"}


def _write_soft_body(group: Any, body: "SoftBody") -> None:
    group.attrs["name"] = body.name
    group.attrs["nodes"] = (body.nodes.start, body.nodes.stop)
    group["mesh_nodes"] = body.mesh.nodes
    group["rest_position"] = body.rest_position
    group["elements"] = body.elements
    group["material"], group["poisson_ratio"] = body.material, _poisson_ratio(body.lame)
    for kind in ("element_groups", "surface_groups"):
        groups = group.create_group(kind)
        for name, members in getattr(body.mesh, kind).items():
            groups[name] = members
    _write_surface(group.create_group("surface"), body.surface)
    for number, cavity in enumerate(body.cavities):
        cavity_group = group.create_group(f"cavities/{number}")
        cavity_group.attrs["name"] = cavity.name
        _write_surface(cavity_group, cavity.surface)


def _poisson_ratio(lame: np.ndarray) -> np.ndarray:
    first, second = lame.T
    ratio: np.ndarray = 0.5 * first / (first + second)
    return ratio


def _write_surface(group: Any, surface: MappedSurface) -> None:
    group["nodes"], group["weights"], group["triangles"] = surface.nodes, surface.weights, surface.triangles


def _read_surface(group: Any) -> MappedSurface:
    return MappedSurface(group["nodes"][:], group["weights"][:], group["triangles"][:])


def _nodes(group: Any) -> slice:
    return slice(*map(int, group.attrs["nodes"]))


def _numbered(file: Any, name: str) -> list[Any]:
    """The groups "0", "1", ... of a group, in this order; HDF5 lists them as words ("10" before "2")."""
    return [file[name][key] for key in sorted(file[name], key=int)] if name in file else []
