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
from taichisoft.mechanics import (
    ACTUATOR_KINDS,
    ActuatorKind,
    BodySurface,
    Line,
    MovingFrames,
    Plane,
    Surface,
    SurfaceKind,
    soft_surface,
)
from taichisoft.mesh import MappedSurface, VolumeMesh, linear_parts
from taichisoft.scene import scene_to_toml
from taichisoft_outputs.recording.layout import LAYOUT
from taichisoft_outputs.recording.recording_file import write_array, write_text, write_texts

if TYPE_CHECKING:
    from taichisoft.contact import Model
    from taichisoft.mechanics import SoftBody


PACKAGES = ("taichi", "numpy", "scipy", "h5py")

LINE_ARRAYS = ("owner", "nodes", "weights", "place")
LINE_NUMBERS = ("rest_length", "friction", "has_pull_point", "frame")
"""Attributes of a `Line` that are datasets of its group, and those that are attributes."""


@dataclass(frozen=True)
class RecordedSurface(Surface):
    """A surface in the instants of a recording.

    Attributes:
        vertices: gives the positions of the vertices [mm], shape (vertex_count, 3), in an instant.
        mapping: the map from all soft nodes to the vertices; None for surfaces that keep their shape.
    """

    vertices: Callable[[int], np.ndarray]
    mapping: MappedSurface | None = None


@dataclass(frozen=True)
class RecordedSoftBody:
    """A soft body; node indices count within it.

    Attributes:
        name: name of the body.
        nodes: where its nodes stand in `row("position", instant)` and the other arrays of all nodes.
        rest_position: placed nodes [mm], shape (node_count, 3).
        elements: node indices of each element, shape (element_count, nodes_per_element).
        material: column of each element's material in `row("young_modulus", instant)`, shape (element_count,).
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
    """Write what does not change during a run.

    Args:
        columns: names of the columns of quantities by actuator, by pair of bodies and by material: "cavities" and the
            like, "pairs" and "materials".
    """
    attributes = file.attrs
    write_text(attributes, "taichisoft_version", taichisoft.__version__)
    write_text(attributes, "versions", json.dumps(_versions()))
    attributes["layout"] = LAYOUT
    attributes["every"] = every
    attributes["gravity"] = np.array(model.scene.gravity, dtype=np.float64)
    attributes["step_size"] = float(model.scene.time.step)
    write_texts(file, "scene", [scene_to_toml(model.scene)])
    for kind, names in {**columns, "bodies": model.body_names}.items():
        write_texts(file.require_group("columns"), kind, names)
    frames = file.create_group("frames")
    write_texts(frames, "names", model.frames.names)
    _write_arrays(frames, parent=model.frames.parent, pivot=model.frames.pivot)
    for index, body in enumerate(model.soft_bodies):
        _write_soft_body(file.create_group(f"soft_bodies/{index}"), body)
    for index, rigid in enumerate(model.rigid_bodies):
        group = _named_group(file, f"rigid_bodies/{index}", rigid.name)
        _write_arrays(group, vertices=rigid.vertices, triangles=rigid.triangles)
    for index, obstacle in enumerate(model.obstacles):
        group = _named_group(file, f"obstacles/{index}", obstacle.name)
        if obstacle.vertices is None:
            group.attrs["point"], group.attrs["normal"] = obstacle.point, obstacle.normal
        else:
            _write_arrays(group, vertices=obstacle.vertices, triangles=obstacle.triangles)
    for actuator in ACTUATOR_KINDS:
        for line in model.actuators.sets[actuator.name].lines:
            group = _named_group(file, f"{actuator.plural}/{line.number}", line.name)
            for name in LINE_NUMBERS:
                group.attrs[name] = getattr(line, name)
            _write_arrays(group, **{name: getattr(line, name) for name in LINE_ARRAYS})


def read_frames(file: Any) -> MovingFrames:
    """The frames that carry bodies, the base first."""
    group = file["frames"]
    return MovingFrames(tuple(read_texts(group["names"])), group["parent"][:], group["pivot"][:])


def read_texts(dataset: Any) -> list[str]:
    """The texts of a dataset."""
    return list(dataset.asstr()[:])


def read_soft_bodies(file: Any) -> list[RecordedSoftBody]:
    """The soft bodies in the order of the scene."""
    return [
        RecordedSoftBody(
            name=_name(group),
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


SOFT_KINDS: dict[SurfaceKind, str] = {"cavity": "cavities", "membrane": "membranes", "fibre": "fibres"}
"""Groups of surfaces within a soft body, in the order of `body_surfaces`."""


def read_surfaces(file: Any) -> Iterator[BodySurface]:
    """The surfaces in the order of `taichisoft.mechanics.body_geometry.body_surfaces`."""
    for group in _numbered(file, "soft_bodies"):
        yield soft_surface(_name(group), "soft", _read_surface(group["surface"]), _nodes(group))
        for kind, plural in SOFT_KINDS.items():
            for inner in _numbered(group, plural):
                yield soft_surface(_name(inner), kind, _read_surface(inner), _nodes(group))
    for index, group in enumerate(_numbered(file, "rigid_bodies")):
        yield BodySurface(_name(group), "rigid", group["triangles"][:], group["vertices"][:], index)
    for group in _numbered(file, "obstacles"):
        if "vertices" in group:
            yield BodySurface(_name(group), "obstacle", group["triangles"][:], group["vertices"][:])


def read_planes(file: Any) -> list[Plane]:
    """The infinite obstacles."""
    return [
        Plane(_name(group), group.attrs["point"], group.attrs["normal"])
        for group in _numbered(file, "obstacles")
        if "point" in group.attrs
    ]


def read_lines(file: Any, kind: ActuatorKind) -> Iterator[Line]:
    """The lines of a kind's actuators in the order of the scene."""
    for number, group in enumerate(_numbered(file, kind.plural)):
        arrays = {name: group[name][:] for name in LINE_ARRAYS}
        numbers = {name: group.attrs[name].item() for name in LINE_NUMBERS}
        yield Line(_name(group), number, **arrays, **numbers)


def _versions() -> dict[str, str]:
    """Versions of the programs that compute the run, and the kind of machine."""
    versions = {"taichisoft": taichisoft.__version__, "Python": platform.python_version()}
    for package in PACKAGES:
        with suppress(PackageNotFoundError):
            versions[package] = version(package)
    return {**versions, "machine": f"{platform.system()} {platform.machine()}"}


def _write_soft_body(group: Any, body: "SoftBody") -> None:
    write_text(group.attrs, "name", body.name)
    group.attrs["nodes"] = (body.nodes.start, body.nodes.stop)
    _write_arrays(
        group,
        mesh_nodes=body.mesh.nodes,
        rest_position=body.rest_position,
        elements=body.elements,
        material=body.material,
        poisson_ratio=_poisson_ratio(body.lame),
    )
    for kind in ("element_groups", "surface_groups"):
        _write_arrays(group.create_group(kind), **getattr(body.mesh, kind))
    _write_surface(group.create_group("surface"), body.surface)
    for number, cavity in enumerate(body.cavities):
        _write_surface(_named_group(group, f"cavities/{number}", cavity.name), cavity.surface)
    for number, (name, kind, surface) in enumerate(body.reinforcement_surfaces):
        _write_surface(_named_group(group, f"{SOFT_KINDS[kind]}/{number}", name), surface)


def _poisson_ratio(lame: np.ndarray) -> np.ndarray:
    first, second = lame.T
    ratio: np.ndarray = 0.5 * first / (first + second)
    return ratio


def _write_surface(group: Any, surface: MappedSurface) -> None:
    _write_arrays(group, nodes=surface.nodes, weights=surface.weights, triangles=surface.triangles)


def _named_group(parent: Any, path: str, name: str) -> Any:
    group = parent.create_group(path)
    write_text(group.attrs, "name", name)
    return group


def _write_arrays(group: Any, /, **arrays: Any) -> None:
    for name, values in arrays.items():
        write_array(group, name, values)


def _read_surface(group: Any) -> MappedSurface:
    return MappedSurface(group["nodes"][:], group["weights"][:], group["triangles"][:])


def _name(group: Any) -> str:
    return str(group.attrs["name"].decode())


def _nodes(group: Any) -> slice:
    return slice(*map(int, group.attrs["nodes"]))


def _numbered(file: Any, name: str) -> list[Any]:
    """The groups "0", "1", ... of a group, in this order; HDF5 lists them as words ("10" before "2")."""
    return [file[name][key] for key in sorted(file[name], key=int)] if name in file else []
