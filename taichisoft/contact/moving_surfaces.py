"""Where the surfaces of a simulation are."""

import numpy as np

from taichisoft.bodies.kernels.rigid_integration import RigidState
from taichisoft.contact import shapes
from taichisoft.contact.kernels.approach import SoftMotion, move_bodies
from taichisoft.contact.kernels.box_trees import refit
from taichisoft.contact.kernels.round_shapes import move_shapes
from taichisoft.contact.kernels.smooth_surfaces import turn_normals
from taichisoft.contact.kernels.surface_vertices import MovedSurfaces, Poses, move_vertices
from taichisoft.contact.surfaces import ContactSurfaces
from taichisoft.state import State


class MovingSurfaces:
    """The vertices and boxes of contact surfaces, and the round shapes, which follow the bodies of one simulation.

    Attributes:
        moved: vertices and boxes now.
        shapes: axes of the round shapes now.
        smooth: the surfaces that stand for curved ones, with their normals now.
    """

    def __init__(self, surfaces: ContactSurfaces):
        """Begin with all vertices where they are at rest, those of rigid bodies in body axes."""
        self._surfaces = surfaces
        self._has_level_ends = bool(surfaces.shapes.flat.any())
        tree_nodes = len(surfaces.trees.escape)
        self.moved = MovedSurfaces(
            position=surfaces.carriers.local.copy(),
            lower=np.zeros((tree_nodes, 3)),
            upper=np.zeros((tree_nodes, 3)),
        )
        self.shapes = shapes.moved_shapes(surfaces.shapes)
        self.smooth = surfaces.smooth._replace(normal=surfaces.smooth.local_normal.copy())
        refit(np.arange(surfaces.count, dtype=np.int32), surfaces.trees, self.moved)
        # Arrays that stay in place: a launch with new ones takes longer than the arithmetic.
        self._poses = Poses(
            node_position=np.zeros((surfaces.node_count, 3)),
            rigid_position=np.zeros((surfaces.rigid_count, 3)),
            rigid_rotation=np.zeros((surfaces.rigid_count, 3, 3)),
        )

    def update(self, node_position: np.ndarray, rigid_position: np.ndarray, rigid_rotation: np.ndarray) -> None:
        """Move the vertices and boxes with the nodes (N, 3) [mm] and rigid poses, (R, 3) [mm] and (R, 3, 3)."""
        poses = self._poses
        poses.node_position[:] = node_position
        poses.rigid_position[:] = rigid_position
        poses.rigid_rotation[:] = rigid_rotation
        self._follow_poses()

    def move(self, passed: float, soft: SoftMotion, rigid: RigidState) -> None:
        """Move everything to where it is a time `passed` [s] after the start of a step, as the bodies move then."""
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
        """Tell level ends of cylinders, where they are now, where the load of the step before `state` went through."""
        if self._has_level_ends:
            shapes.update_lean(self._surfaces.shapes, self.shapes, state)

    def boxes(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corner [mm] of each surface's bounding box, each (surface_count, 3); not of shapes."""
        root = self._surfaces.trees.root[:-1]
        return self.moved.lower[root], self.moved.upper[root]
