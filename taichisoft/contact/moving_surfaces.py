"""The moving surfaces of a simulation."""

import numpy as np

from taichisoft.bodies.kernels.rigid_integration import RigidState
from taichisoft.contact.shapes import moved_shapes, update_lean
from taichisoft.contact.kernels.approach import NodeMotion, move_bodies
from taichisoft.contact.kernels.box_trees import refit
from taichisoft.contact.kernels.round_shapes import move_shapes
from taichisoft.contact.kernels.smooth_surfaces import turn_normals
from taichisoft.contact.kernels.surface_vertices import MovedSurfaces, PoseArrays, move_vertices
from taichisoft.contact.surfaces import ContactSurfaces
from taichisoft.state import State


class MovingSurfaces:
    """Current vertices and boxes of contact surfaces, and current round shapes, of one simulation.

    Attributes:
        moved: vertices and boxes.
        shapes: axes of the round shapes.
        smooth: the surfaces treated as curved, with their normals.
    """

    def __init__(self, surfaces: ContactSurfaces):
        """Start with all vertices at rest, vertices of rigid bodies in body axes."""
        self._surfaces = surfaces
        self._has_level_ends = bool(surfaces.shapes.flat.any())
        tree_nodes = len(surfaces.trees.escape)
        self.moved = MovedSurfaces(
            position=surfaces.carriers.local.copy(),
            lower=np.zeros((tree_nodes, 3)),
            upper=np.zeros((tree_nodes, 3)),
        )
        self.shapes = moved_shapes(surfaces.shapes)
        self.smooth = surfaces.smooth._replace(normal=surfaces.smooth.local_normal.copy())
        refit(np.arange(surfaces.count, dtype=np.int32), surfaces.trees, self.moved)
        # Reused arrays: a kernel launch with new arrays takes longer than the arithmetic.
        self._poses = PoseArrays(
            node_position=np.zeros((surfaces.node_count, 3)),
            rigid_position=np.zeros((surfaces.rigid_count, 3)),
            rigid_rotation=np.zeros((surfaces.rigid_count, 3, 3)),
        )

    def update(self, node_position: np.ndarray, rigid_position: np.ndarray, rigid_rotation: np.ndarray) -> None:
        """Move the surfaces to node positions (N, 3) [mm] and rigid poses, (R, 3) [mm] and (R, 3, 3)."""
        poses = self._poses
        poses.node_position[:] = node_position
        poses.rigid_position[:] = rigid_position
        poses.rigid_rotation[:] = rigid_rotation
        self._follow_poses()

    def move(self, passed: float, soft: NodeMotion, rigid: RigidState) -> None:
        """Move the surfaces to a time `passed` [s] after the start of a step, at the velocities of the start."""
        move_bodies(passed, soft, rigid, self._poses)
        self._follow_poses()

    def _follow_poses(self) -> None:
        poses, surfaces = self._poses, self._surfaces
        move_vertices(surfaces.carriers, poses, self.moved)
        refit(surfaces.topology.moving, surfaces.trees, self.moved)
        if len(surfaces.shapes.moving):
            move_shapes(surfaces.shapes, poses, self.shapes)
        if len(surfaces.smooth.moving):
            turn_normals(self.smooth, surfaces.carriers, poses)

    def follow_load(self, state: State) -> None:
        """Align the contact points of level cylinder ends with the load in the step that led to `state`."""
        if self._has_level_ends:
            update_lean(self._surfaces.shapes, self.shapes, state)

    def boxes(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corners [mm] of the bounding boxes of surfaces, without shapes, each (surface_count, 3)."""
        root = self._surfaces.trees.root[:-1]
        return self.moved.lower[root], self.moved.upper[root]
