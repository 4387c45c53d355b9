"""What never changes during a run, made from a scene once."""

from collections.abc import Mapping

import numpy as np

from taichisoft.cavities import Cavities
from taichisoft.contact.detection import ContactDetection
from taichisoft.contact.overlap import refuse_overlap
from taichisoft.contact.selection import ContactSelection
from taichisoft.contact.surfaces import ContactSurfaces
from taichisoft.elasticity import Elasticity
from taichisoft.mesh import VolumeMesh
from taichisoft.rigid_body import make_obstacle, make_rigid_body
from taichisoft.scene import Scene
from taichisoft.scenes.body_meshes import load_meshes
from taichisoft.scenes.placement import matrices_from_quaternions
from taichisoft.soft_body import SoftBody, make_soft_body


class Model:
    """Arrays, element data, sparsity and factorisation, surfaces.

    Bodies are numbered: soft bodies, then rigid bodies, then obstacles, each in the scene's order.

    Attributes:
        scene: where it comes from.
        soft_bodies, rigid_bodies, obstacles: the bodies.
        body_names: names by body number.
        rest_position: soft nodes [mm], shape (node_count, 3).
        elasticity: forces and the system matrix; None without soft bodies.
        cavities: all cavities.
        surfaces: all contact surfaces.
        friction: coefficient by the numbers of two bodies, shape (body_count, body_count).
        base_pivot: the point about which the base turns [mm], shape (3,).
        rigid_mass: [kg], shape (rigid_count,).
        rigid_inertia: in the body frames [kg mm^2], shape (rigid_count, 3, 3).
        gravity: [mm/s^2], shape (3,).
    """

    def __init__(self, scene: Scene, meshes: Mapping[str, VolumeMesh] | None = None):
        """Read the files that a scene names and lay out the arrays.

        Args:
            scene: what to simulate.
            meshes: by the names of the soft bodies, instead of those that the scene names.

        Raises:
            MeshError: a file is not fit to simulate.
            SceneError: something in the scene does not fit its meshes, or bodies overlap at the start.
        """
        self.scene = scene
        soft: list[SoftBody] = []
        node_count = 0
        meshes = load_meshes(scene) if meshes is None else meshes
        for name, body in scene.soft_bodies.items():
            soft.append(make_soft_body(name, body, meshes[name], node_count))
            node_count = soft[-1].nodes.stop
        self.soft_bodies = tuple(soft)
        self.rigid_bodies = tuple(make_rigid_body(name, body) for name, body in scene.rigid_bodies.items())
        self.obstacles = tuple(make_obstacle(name, obstacle) for name, obstacle in scene.obstacles.items())
        self.body_names = (*scene.soft_bodies, *scene.rigid_bodies, *scene.obstacles)
        self.rest_position = np.vstack([np.zeros((0, 3)), *(body.rest_position for body in soft)])
        self.elasticity = Elasticity(soft, scene.time.step) if soft else None
        self.cavities = Cavities(soft)
        self.surfaces = ContactSurfaces(soft, self.rigid_bodies, self.obstacles)
        self.detection = ContactDetection(self.surfaces)
        self.contact_selection = ContactSelection(self.surfaces.body_size)
        self.friction = self._friction_table()
        self.base_pivot = self._find_base_pivot()
        self.rigid_mass = np.array([body.mass for body in self.rigid_bodies])
        self.rigid_inertia = np.array([body.inertia for body in self.rigid_bodies]).reshape(-1, 3, 3)
        self.gravity = np.array(scene.gravity)
        rotation = np.array([body.start_rotation for body in self.rigid_bodies]).reshape(-1, 4)
        position = np.array([body.start_position for body in self.rigid_bodies]).reshape(-1, 3)
        self.surfaces.update(self.rest_position, position, matrices_from_quaternions(rotation))
        refuse_overlap(self.surfaces, self.detection, self.body_names)

    @property
    def node_count(self) -> int:
        """Number of soft nodes."""
        return len(self.rest_position)

    def body_of_node(self, node: int) -> str:
        """Name of the soft body that has a node."""
        return next(body.name for body in self.soft_bodies if body.nodes.start <= node < body.nodes.stop)

    def _friction_table(self) -> np.ndarray:
        table = np.full((len(self.body_names), len(self.body_names)), self.scene.contact.friction)
        for pair in self.scene.contact.pairs:
            first, second = (self.body_names.index(name) for name in pair.bodies)
            table[first, second] = table[second, first] = pair.friction
        return table

    def _find_base_pivot(self) -> np.ndarray:
        if self.scene.base_pivot is not None:
            return np.array(self.scene.base_pivot)
        if self.elasticity is None or not (self.elasticity.anchor_stiffness > 0).any():
            return np.zeros(3)
        return self.rest_position[self.elasticity.anchor_stiffness > 0].mean(axis=0)
