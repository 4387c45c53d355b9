"""Soft bodies that are copies of each other up to their placement: they share a basis."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from taichisoft import Scene

if TYPE_CHECKING:
    from taichisoft.contact import Model
    from taichisoft.mechanics import FramePlaces, SoftBody

NOT_OF_THE_SHAPE = {"follows", "rotation", "translation", "velocity", "colour", "axes", "tip", "reduced"}
"""Keys of a soft body in which copies may differ: they change neither its mesh nor its forces."""


@dataclass(frozen=True)
class BodyShape:
    """A mesh with its material, of which a scene has one or several bodies.

    Attributes:
        name: name of the first of its bodies, by which its file is called.
        bodies: names of its bodies in the scene.
    """

    name: str
    bodies: tuple[str, ...]


def body_shapes(scene: Scene) -> list[BodyShape]:
    """The shapes of the scene's anchored soft bodies, in the scene's order; others have no frame to be relative to."""
    by_key: dict[str, list[str]] = {}
    for name, body in scene.soft_bodies.items():
        if body.anchors:
            by_key.setdefault(shape_key(body), []).append(name)
    return [BodyShape(names[0], tuple(names)) for names in by_key.values()]


def shape_key(body: Any) -> str:
    """A text that copies of a soft body, given by its table in a scene, have in common."""
    return repr(sorted(body.model_dump(mode="json", exclude=NOT_OF_THE_SHAPE).items()))


def mesh_digest(bodies: "Iterable[SoftBody]") -> str:
    """A digest of the meshes of soft bodies, whose files may change under the same name."""
    whole = hashlib.sha256()
    for body in bodies:
        for array in (body.mesh.nodes, body.elements, body.node_mass, body.anchor_stiffness):
            whole.update(np.ascontiguousarray(array).tobytes())
    return whole.hexdigest()


class RelativeMotion:
    """Displacements of a soft body in the axes of its mesh, relative to the frame that it follows."""

    def __init__(self, mesh_nodes: np.ndarray, rotation: Iterable[float], translation: Iterable[float]):
        """Take the nodes of the mesh [mm], shape (node_count, 3), and the placement of the body as in its scene."""
        self._nodes = mesh_nodes
        self._turn = Rotation.from_euler("xyz", list(rotation), degrees=True).as_matrix()
        self._shift = np.array(list(translation))

    @classmethod
    def of_body(cls, body: "SoftBody") -> "RelativeMotion":
        """That of a body of a model."""
        return cls(body.mesh.nodes, body.settings.rotation, body.settings.translation)

    def displacement(self, position: np.ndarray, places: "FramePlaces", frame: int) -> np.ndarray:
        """Displacements [mm] of nodes at positions in space [mm], both of shape (node_count, 3).

        Args:
            position: of the body's nodes.
            places: where the frames are.
            frame: number of the frame that the body follows.
        """
        placed = (position - places.shift[frame]) @ places.turn[frame]
        relative: np.ndarray = (placed - self._shift) @ self._turn - self._nodes
        return relative


def relative_motions(model: "Model", names: Iterable[str]) -> dict[str, RelativeMotion]:
    """The motions of some bodies of a model by their names."""
    chosen = set(names)
    return {body.name: RelativeMotion.of_body(body) for body in model.soft_bodies if body.name in chosen}
