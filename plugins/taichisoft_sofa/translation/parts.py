"""What a translation consists of, and the files that go with it."""

import hashlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import taichisoft
from taichisoft.meshes.files import write_volume_mesh
from taichisoft.meshes.surface_files import write_stl
from taichisoft.meshes.volume_mesh import VolumeMesh

if TYPE_CHECKING:
    from taichisoft_sofa.components.draft import Body
    from taichisoft_sofa.tree.component import Component


@dataclass(frozen=True)
class SoftPart:
    """A soft body as it was made of a draft.

    Attributes:
        body: what it was made of.
        points: SOFA's index of each of its nodes, shape (node_count,).
        elements: node indices of its tetrahedra, shape (element_count, 4).
        material: number of the native material of each of them: 0 the body's own, from 1 on those of its regions.
        anchored: native indices of the anchored nodes, rising, shape (anchor_count,).
        anchored_follows: whether each of them follows `rest_position`, else it is fixed, shape (anchor_count,).
    """

    body: "Body"
    points: np.ndarray
    elements: np.ndarray
    material: np.ndarray
    anchored: np.ndarray
    anchored_follows: np.ndarray


@dataclass
class Translation:
    """A scene of SOFA as a native one.

    Attributes:
        tables: what the native scene would have in TOML; files are named as `files` has them.
        files: meshes and surfaces.
        names: native names by component: bodies by their mechanical objects, cavities and cables by their constraints.
        effort_of_value: pressure [kPa] or tension [mN] by the value that SOFA calls so.
        signs: 1 by cavity whose walls face outward, seen from the air; -1 where a pressure shrinks it.
        soft: soft bodies by native name.
        rigid: rigid bodies by native name.
        departures: what is done otherwise than in SOFA, one line each.
        understood: number of components of each type that were translated.
        ignored: number of components of each type without which the scene moves just the same.
        refused: what cannot be done, one line each.
    """

    tables: dict[str, Any] = field(default_factory=dict)
    files: "MeshFiles" = field(default_factory=lambda: MeshFiles())
    names: "dict[Component, str]" = field(default_factory=dict)
    effort_of_value: float = 1.0
    signs: "dict[Component, float]" = field(default_factory=dict)
    soft: dict[str, SoftPart] = field(default_factory=dict)
    rigid: "dict[str, Body]" = field(default_factory=dict)
    departures: list[str] = field(default_factory=list)
    understood: dict[str, int] = field(default_factory=dict)
    ignored: dict[str, int] = field(default_factory=dict)
    refused: list[str] = field(default_factory=list)


class MeshFiles:
    """The meshes and surfaces of a translation, by the names of their files; written once they are needed."""

    def __init__(self) -> None:
        self._volumes: dict[str, VolumeMesh] = {}
        self._surfaces: dict[str, tuple[np.ndarray, np.ndarray]] = {}

    def volume(self, name: str, mesh: VolumeMesh) -> str:
        """Add a mesh of tetrahedra and return the name of its file."""
        self._volumes[f"{name}.msh"] = mesh
        return f"{name}.msh"

    def surface(self, name: str, points: np.ndarray, triangles: np.ndarray) -> str:
        """Add a surface and return the name of its file."""
        self._surfaces[f"{name}.stl"] = points, triangles
        return f"{name}.stl"

    def fingerprint(self) -> str:
        """A hash of everything that would be written."""
        whole = hashlib.sha256(taichisoft.__version__.encode())
        for name, mesh in self._volumes.items():
            for array in (mesh.nodes, mesh.elements, *mesh.element_groups.values()):
                whole.update(f"{name} {array.shape} ".encode() + np.ascontiguousarray(array).tobytes())
        for name, surface in self._surfaces.items():
            for array in surface:
                whole.update(f"{name} {array.shape} ".encode() + np.ascontiguousarray(array).tobytes())
        return whole.hexdigest()

    @property
    def names(self) -> list[str]:
        """The names of all files."""
        return [*self._volumes, *self._surfaces]

    def write(self, folder: Path) -> None:
        """Write all files into a folder.

        Raises:
            MeshError: one cannot be written.
        """
        for name, mesh in self._volumes.items():
            write_volume_mesh(mesh, folder / name)
        for name, (points, triangles) in self._surfaces.items():
            write_stl(points, triangles, folder / name)
