"""Data computed by loaders and topology containers: transformed points, and cells."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taichisoft.errors import MeshError, SceneError
from taichisoft_sofa.components.graph import LOADERS, in_node, node_of
from taichisoft_sofa.components.regular_grids import mapped_cells
from taichisoft_sofa.components.typed_values import computed, described, is_given, number, numbers, text, vector
from taichisoft_sofa.meshes.loaded_mesh import LoadedMesh
from taichisoft_sofa.meshes.placement import placed_by_loader
from taichisoft_sofa.meshes.reading import read_mesh
from taichisoft_sofa.meshes.stock import find_mesh
from taichisoft_sofa.tree.modules import running

if TYPE_CHECKING:
    from taichisoft_sofa.tree.component import Component

CORNERS = {"edges": 2, "triangles": 3, "quads": 4, "tetrahedra": 4, "hexahedra": 8}
"""Number of corners of each kind of cell."""

OTHER_NAMES = {"tetrahedra": ("tetras",), "hexahedra": ("hexas",)}
"""Older names of the data with cells."""


def read_loader(loader: "Component") -> LoadedMesh:
    """The mesh of a loader, as in the file.

    Raises:
        SceneError: the loader names no file, or the file is missing or unreadable.
    """
    name = text(loader, "filename", "fileMesh", "fileTopology")
    if not name:
        raise SceneError(f"{described(loader)}: filename is missing; name a mesh")
    try:
        return read_mesh(find_mesh(name, file_finder(loader)))
    except MeshError as error:
        raise SceneError(f"{described(loader)}: {error}") from error


def file_finder(component: "Component") -> Callable[[str], Path | None]:
    """Function that finds the files of a scene: of its tree, or, during the construction, of the running scene."""
    root = node_of(component).getRoot()
    find: Callable[[str], Path | None] = getattr(root, "_find_file", None) or running().find_file
    return find


def loader_position(loader: "Component") -> np.ndarray:
    """Points of a loader [mm], scaled, rotated and translated, shape (count, 3)."""
    scale = vector(loader, "scale3d", default=[number(loader, "scale", default=1.0)] * 3)
    rotation = vector(loader, "rotation", "rotation2", default=(0.0, 0.0, 0.0))
    translation = vector(loader, "translation", "translation2", default=(0.0, 0.0, 0.0))
    return placed_by_loader(read_loader(loader).points, scale.tolist(), rotation.tolist(), translation.tolist())


def source_of(component: "Component") -> "Component | None":
    """The component of `src`, else the loader in the container's node; None if the container reads a file itself."""
    link = text(component, "src")
    if link:
        return component.linked("src")
    if text(component, "filename", "fileTopology"):
        return None
    return in_node(node_of(component), LOADERS)


def container_position(container: "Component") -> np.ndarray:
    """Points of a topology container [mm], shape (count, 3)."""
    if is_given(container, "position"):
        return numbers(container, "position").reshape(-1, 3)
    source = source_of(container)
    if source is not None:
        return computed(source, "position", 3)
    return loader_position(container) if text(container, "filename", "fileTopology") else np.zeros((0, 3))


def container_cells(container: "Component", kind: str) -> np.ndarray:
    """Cells of a topology container: the cells of its source, or what a topological mapping makes of others."""
    for name in (kind, *OTHER_NAMES.get(kind, ())):
        if is_given(container, name):
            return numbers(container, name).astype(np.int64).reshape(-1, CORNERS[kind])
    if (mapped := mapped_cells(container, kind)) is not None:
        return mapped
    source = source_of(container)
    if source is not None:
        return computed(source, kind, CORNERS[kind])
    own = text(container, "filename", "fileTopology")
    return getattr(read_loader(container), kind) if own else np.zeros((0, CORNERS[kind]), dtype=np.int64)
