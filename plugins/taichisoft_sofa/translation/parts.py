"""What a translation consists of, and the folder into which it writes meshes."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.meshes.files import write_volume_mesh
from taichisoft.meshes.surface_files import write_stl
from taichisoft.meshes.volume_mesh import VolumeMesh

if TYPE_CHECKING:
    from taichisoft_sofa.draft import Body
    from taichisoft_sofa.tree.component import Component


@dataclass(frozen=True)
class SoftPart:
    """A soft body as it was made of a draft.

    Attributes:
        body: what it was made of.
        points: SOFA's index of each of its nodes, shape (node_count,).
        elements: node indices of its tetrahedra, shape (element_count, 4).
        follows_rest: native indices of the anchored nodes that follow `rest_position`, shape (count,).
    """

    body: "Body"
    points: np.ndarray
    elements: np.ndarray
    follows_rest: np.ndarray


@dataclass
class Translation:
    """A scene of SOFA as a native one.

    Attributes:
        tables: what the native scene would have in TOML; files are absolute paths.
        names: native names by component: bodies by their mechanical objects, cavities and cables by their constraints.
        soft: soft bodies by native name.
        rigid: rigid bodies by native name.
        colours: colours (red, green, blue, opacity) of bodies by native name.
        background: colour behind the scene, None where the scene gives none.
        departures: what is done otherwise than in SOFA, one line each.
        understood: number of components of each type that were translated.
        ignored: number of components of each type without which the scene moves just the same.
        refused: what cannot be done, one line each.
    """

    tables: dict[str, Any] = field(default_factory=dict)
    names: "dict[Component, str]" = field(default_factory=dict)
    soft: dict[str, SoftPart] = field(default_factory=dict)
    rigid: "dict[str, Body]" = field(default_factory=dict)
    colours: dict[str, list[float]] = field(default_factory=dict)
    background: list[float] | None = None
    departures: list[str] = field(default_factory=list)
    understood: dict[str, int] = field(default_factory=dict)
    ignored: dict[str, int] = field(default_factory=dict)
    refused: list[str] = field(default_factory=list)


class MeshFolder:
    """Where meshes are written; None writes nothing, for who needs the tables alone."""

    def __init__(self, folder: Path | None):
        self._folder = folder

    def volume(self, name: str, mesh: VolumeMesh) -> str:
        """Write a mesh of tetrahedra and return its path.

        Raises:
            MeshError: it cannot be written.
        """
        path = self._path(f"{name}.msh")
        if self._folder is not None:
            write_volume_mesh(mesh, path)
        return str(path)

    def surface(self, name: str, points: np.ndarray, triangles: np.ndarray) -> str:
        """Write a surface and return its path.

        Raises:
            MeshError: it cannot be written.
        """
        path = self._path(f"{name}.stl")
        if self._folder is not None:
            write_stl(points, triangles, path)
        return str(path)

    def _path(self, name: str) -> Path:
        return (self._folder or Path()) / name
