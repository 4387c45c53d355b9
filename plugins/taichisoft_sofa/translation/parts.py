"""The result of a translation, with its files."""

import hashlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import taichisoft
from taichisoft.mesh import VolumeMesh, write_stl, write_volume_mesh
from taichisoft_sofa.components.contact import friction_of, response_of
from taichisoft_sofa.components.draft import DraftBody, DraftJoint, SceneDraft
from taichisoft_sofa.components.reading import node_of, upwards
from taichisoft_sofa.components.states import AnchorTarget, FrameMotion, FramePoses, start_values
from taichisoft_sofa.tree.component import Component
from taichisoft_sofa.tree.node import Node

# The contact table of a scene.

NO_TRIANGLES = "its topology has no triangles; points and lines alone do not collide here"
"""Why a collision surface is refused."""
NEEDED = ("pipeline", "broad phase", "response")
SPACING = 0.8
"""Distance below which only one of two contacts is kept, as a fraction of the alarm distance [-]."""


def collides(draft: SceneDraft) -> bool:
    """Whether bodies touch: constraints need an animation loop that solves them, penalty forces none."""
    if not all(role in draft.pipeline for role in NEEDED):
        return False
    return draft.free_motion or response_of(draft.pipeline["response"]).startswith("Penal")


def contact_table(draft: SceneDraft) -> dict[str, Any]:
    """Friction and distances; without collisions the engine's defaults."""
    if not collides(draft):
        return {}
    draft.depart(
        "contact: bodies slide by the whole of their free motion, of which SOFA drops the tangential part where they "
        "separate; contacts are solved until they change by less than 1e-5 mm/s, whatever tolerance the scene gives"
    )
    if "narrow phase" not in draft.pipeline:
        draft.depart(
            "contact: is found, though there is no narrow phase, without which SOFA v21.06 and later find none"
        )
    table: dict[str, Any] = {"friction": friction_of(draft.pipeline["response"], draft)}
    if "distance" in draft.pipeline:
        alarm, contact = map(draft.pipeline["distance"].read_number, ("alarmDistance", "contactDistance"))
        table |= {"alarm_distance": alarm, "contact_distance": contact, "spacing": SPACING * alarm}
    return table


# Names of bodies, cavities and cables: the shortest distinct names of their nodes.


def body_names(nodes: "Sequence[Node]") -> list[str]:
    """Name the body of each node: by the node, or by an ancestor if bodies share the node's name; several in one node
    are numbered.

    Three nodes "ElasticMaterialObject" below "Finger1", "Finger2" and "Finger3" are named "Finger1", and so on.
    """
    if len(each := list({id(node): node for node in nodes}.values())) < len(nodes):
        name_of = dict(zip(map(id, each), body_names(each), strict=True))
        return unique([name_of[id(node)] for node in nodes])
    paths = [[clean(above.getName()) for above in upwards(node)] for node in nodes]
    names = [path[0] for path in paths]
    for name, count in Counter(names).items():
        if count > 1:
            same = [index for index, other in enumerate(names) if other == name]
            for index, better in zip(same, _distinct_names([paths[index] for index in same]), strict=True):
                names[index] = better
    return unique(names)


def _distinct_names(paths: list[list[str]]) -> list[str]:
    """Names at the lowest level at which all paths differ, else the whole paths."""
    for level in range(1, min(map(len, paths))):
        names = [path[level] for path in paths]
        if len(set(names)) == len(names):
            return names
    return ["-".join(reversed(path)) for path in paths]


def actuator_names(components: "Sequence[Component]") -> list[str]:
    """Name each actuator of a body: by its node, or by its own name if several share a node."""
    nodes = [node_of(component) for component in components]
    sharing = Counter(map(id, nodes))
    return [
        clean((component if sharing[id(node)] > 1 else node).getName())
        for component, node in zip(components, nodes, strict=True)
    ]


def unique(names: list[str]) -> list[str]:
    """Make names unique by numbers."""
    taken: set[str] = set()
    numbers: dict[str, int] = {}
    found = []
    for name in names:
        free = name
        while free in taken:
            numbers[name] = numbers.get(name, 1) + 1
            free = f"{name}{numbers[name]}"
        taken.add(free)
        found.append(free)
    return found


def clean(name: str) -> str:
    """Replace the characters that join names in a native scene."""
    return name.translate(str.maketrans("./|", "___")) or "unnamed"


@dataclass(frozen=True)
class SoftPart:
    """A translated soft body.

    Attributes:
        body: body of the draft.
        points: SOFA's index of each node, shape (node_count,).
        elements: node indices of the tetrahedra, shape (element_count, 4).
        material: number of each element's native material: 0 for the body's own, from 1 for regions, (element_count,).
        anchored: native indices of the anchored nodes, rising, shape (anchor_count,).
        anchored_follows: whether each anchored node follows `rest_position` along each axis, shape (anchor_count, 3).
        targets: what anchored nodes follow: the target, numbers of the nodes in `anchored`, of its points, of the axes.
    """

    body: "DraftBody"
    points: np.ndarray
    elements: np.ndarray
    material: np.ndarray
    anchored: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    anchored_follows: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), dtype=bool))
    targets: "tuple[tuple[AnchorTarget, np.ndarray, np.ndarray, np.ndarray], ...]" = ()


NOTHING = "holds nothing that moves, touches or can be seen: there is nothing to run"
"""Why a scene is refused that SOFA opens, and where nothing happens."""


@dataclass
class Translation:
    """A native scene made of a SOFA scene.

    Attributes:
        tables: tables of the native scene, with file names as in `files`.
        files: meshes and surfaces.
        names: native names of bodies, cavities and cables, by mechanical object or constraint.
        effort_of_value: pressure [kPa] or tension [mN] per unit of SOFA's value.
        signs: 1 for a cavity whose walls face outward, seen from the air; -1 if a pressure shrinks it.
        soft: soft bodies by native name.
        rigid: rigid bodies by native name.
        driven: mechanical object of SOFA, and index in it, of each native frame, by its name.
        joints: angles that turn frames.
        sprung: mechanical objects of frames that lead to `rest_position`, not `position`.
        motions: motion in time of frames, by their mechanical object.
        springs: how far the cables that stand for springs are pulled in [mm], by native name.
        departures: differences from SOFA, one line each.
        understood: number of components of each type that were translated.
        ignored: number of components of each type without effect on the motion.
        not_read: names of data that the scene writes and nothing reads, by type of component.
        refused: components or values that cannot be translated, one line each.
    """

    tables: dict[str, Any] = field(default_factory=dict)
    files: "MeshFiles" = field(default_factory=lambda: MeshFiles())
    names: "dict[Component, str]" = field(default_factory=dict)
    effort_of_value: float = 1.0
    signs: "dict[Component, float]" = field(default_factory=dict)
    soft: dict[str, SoftPart] = field(default_factory=dict)
    rigid: "dict[str, DraftBody]" = field(default_factory=dict)
    driven: "dict[str, tuple[Component, int]]" = field(default_factory=dict)
    joints: list[DraftJoint] = field(default_factory=list)
    sprung: "dict[Component, None]" = field(default_factory=dict)
    motions: "dict[Component, FrameMotion]" = field(default_factory=dict)
    springs: dict[str, float] = field(default_factory=dict)
    departures: list[str] = field(default_factory=list)
    understood: dict[str, int] = field(default_factory=dict)
    ignored: dict[str, int] = field(default_factory=dict)
    not_read: dict[str, dict[str, None]] = field(default_factory=dict)
    refused: list[str] = field(default_factory=list)

    def add_frame(self, name: str, state: "Component", index: int) -> None:
        """Add a native frame that moves as a frame or point of SOFA; at rest it is where that one is at the start."""
        self.driven[name] = state, index
        pivot = FramePoses(start_values).of(state)[index, :3].tolist()
        self.tables.setdefault("frames", {})[name] = {"pivot": pivot}

    @property
    def data_not_read(self) -> str:
        """Data that the scene writes and nothing reads, after the types of their components; "" without any."""
        return ", ".join(f"{kind} ({', '.join(names)})" for kind, names in sorted(self.not_read.items()))

    @property
    def is_static(self) -> bool:
        """Whether steps lead to equilibria, in which nothing begins with a velocity."""
        return bool(self.tables.get("time", {}).get("dynamics") == "static")

    @property
    def is_empty(self) -> bool:
        """Whether the scene has no body that a run could show."""
        return not self.tables.keys() & {"soft_bodies", "rigid_bodies"}


class MeshFiles:
    """The meshes and surfaces of a translation, by file name; written on demand."""

    def __init__(self) -> None:
        self._volumes: dict[str, VolumeMesh] = {}
        self._surfaces: dict[str, tuple[np.ndarray, np.ndarray]] = {}

    def volume(self, name: str, mesh: VolumeMesh) -> str:
        """Add a mesh of tetrahedra; returns its file name."""
        self._volumes[f"{name}.msh"] = mesh
        return f"{name}.msh"

    def surface(self, name: str, points: np.ndarray, triangles: np.ndarray) -> str:
        """Add a surface; returns its file name."""
        self._surfaces[f"{name}.stl"] = points, triangles
        return f"{name}.stl"

    def fingerprint(self) -> str:
        """Hash of all content to be written."""
        whole = hashlib.sha256(taichisoft.__version__.encode())
        meshes = {name: (m.nodes, m.elements, *m.element_groups.values()) for name, m in self._volumes.items()}
        for name, arrays in (meshes | self._surfaces).items():
            for array in arrays:
                whole.update(f"{name} {array.shape} ".encode() + np.ascontiguousarray(array).tobytes())
        return whole.hexdigest()

    @property
    def names(self) -> list[str]:
        """The names of all files."""
        return [*self._volumes, *self._surfaces]

    def write(self, folder: Path) -> None:
        """Write all files into a folder."""
        for name, mesh in self._volumes.items():
            write_volume_mesh(mesh, folder / name)
        for name, (points, triangles) in self._surfaces.items():
            write_stl(points, triangles, folder / name)
