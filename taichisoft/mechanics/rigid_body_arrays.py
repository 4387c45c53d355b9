"""A rigid body's mass, inertia and surface, and obstacles that never move."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from taichisoft.base.rotations import quaternion_from_matrix, rotation_from_degrees, rotation_from_vector
from taichisoft.errors import SceneError
from taichisoft.mesh.mesh_files import read_surface
from taichisoft.mesh.surface import closed_outward, count_open_edges, enclosed_volume, refuse_unsmooth
from taichisoft.scene import rigid_body as settings
from taichisoft.scene.rigid_body import Shaped

# Shapes without a surface file: their volume and inertia in closed form, and triangles to draw them with.

SPHERE_SUBDIVISIONS = 4  # of an icosahedron: 5120 triangles
SECTIONS = 96  # triangles around a cylinder or capsule
KEPT_PLACES = 4  # of frames, by their last poses


@dataclass(frozen=True)
class RoundShape:
    """A sphere, capsule or cylinder about the origin, its axis along z.

    Attributes:
        radius: [mm].
        length: of the axis: between the flat ends of a cylinder, between the centres of a capsule's half balls, 0 for a
            sphere [mm].
        flat: whether the ends are flat.
    """

    radius: float
    length: float
    flat: bool

    @property
    def volume(self) -> float:
        """[mm^3]."""
        ball = 0.0 if self.flat else 4.0 / 3.0 * self.radius
        return math.pi * self.radius**2 * (self.length + ball)

    @property
    def smallest_extent(self) -> float:
        """[mm]."""
        return min(2.0 * self.radius, self.length) if self.flat else 2.0 * self.radius

    def inertia(self, mass: float) -> np.ndarray:
        """About the centre [kg mm^2], shape (3, 3), of a mass [kg] spread evenly.

        A half ball's centre of mass is 3/8 of the radius beyond its flat side, and its inertia about an axis across
        there is 83/320 of its mass times the radius squared.
        """
        r, length = self.radius, self.length
        cylinder_mass = mass * math.pi * r**2 * length / self.volume
        balls_mass = mass - cylinder_mass if not self.flat else 0.0
        along = cylinder_mass * r**2 / 2.0 + balls_mass * 0.4 * r**2
        across = cylinder_mass * (3.0 * r**2 + length**2) / 12.0
        across += balls_mass * (83.0 / 320.0 * r**2 + (length / 2.0 + 0.375 * r) ** 2)
        return np.diag([across, across, along])

    def triangulated(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices on the surface [mm], shape (vertex_count, 3), and outward triangles, for pictures and files."""
        import trimesh  # takes long, and scenes of soft bodies do without

        if self.flat:
            made = trimesh.creation.cylinder(self.radius, self.length, sections=SECTIONS)
        elif self.length > 0.0:
            made = trimesh.creation.capsule(self.length, self.radius, count=[SECTIONS, SECTIONS])
            made.apply_translation([0.0, 0.0, -made.bounds.mean(axis=0)[2]])
        else:
            made = trimesh.creation.icosphere(SPHERE_SUBDIVISIONS, self.radius)
        return np.array(made.vertices), np.array(made.faces)


def round_shape(body: Shaped) -> RoundShape | None:
    """The round shape that the table of a body or obstacle gives it; None for a box, a plane or a surface."""
    if body.sphere is not None:
        return RoundShape(body.sphere.radius, 0.0, flat=False)
    if body.capsule is not None:
        return RoundShape(body.capsule.radius, body.capsule.length, flat=False)
    if body.cylinder is not None:
        return RoundShape(body.cylinder.radius, body.cylinder.length, flat=True)
    return None


# Frames that move as requested, and carry what is anchored to them or follows them; the base is the first.


@dataclass(frozen=True)
class FramePlaces:
    """Where all frames are: what was at x when they were at rest is at turn @ x + shift.

    Attributes:
        turn: rotation matrices, shape (frame_count, 3, 3).
        shift: shifts [mm], shape (frame_count, 3).
    """

    turn: np.ndarray
    shift: np.ndarray

    def moved(self, points: np.ndarray, frame: int) -> np.ndarray:
        """Points at rest [mm], shape (count, 3), carried along by a frame."""
        moved: np.ndarray = points @ self.turn[frame].T + self.shift[frame]
        return moved


@dataclass(frozen=True)
class MovingFrames:
    """The frames of a scene.

    A pose is the shift of the pivot and a rotation vector about it, in the axes of the frame that carries this one as
    they are at rest; so a jaw opens by the same translation, wherever the base is.

    Attributes:
        names: "base", then the others, each behind the frame that carries it.
        parent: number of the frame that carries each, -1 for frames in space, shape (frame_count,).
        pivot: points about which they turn, at rest [mm], shape (frame_count, 3).
    """

    names: tuple[str, ...]
    parent: np.ndarray
    pivot: np.ndarray
    _last: list[tuple[np.ndarray, FramePlaces]] = field(default_factory=list, repr=False, compare=False)

    def numbers(self, names: Iterable[str | None]) -> np.ndarray:
        """Numbers of frames by name, -1 for None."""
        return np.array([-1 if name is None else self.names.index(name) for name in names], dtype=np.int32)

    def places(self, pose: np.ndarray) -> FramePlaces:
        """Where the frames are, by their translations [mm] and rotation vectors [rad], shape (frame_count, 2, 3).

        Of poses that cannot change, such as those of a `State`, the last ones are remembered: a step asks several
        times, and threads share a model.
        """
        for known, places in self._last:
            if known is pose:
                return places
        places = self._find(pose)
        if not pose.flags.writeable:
            places.turn.setflags(write=False)
            places.shift.setflags(write=False)
            self._last[:] = [(pose, places), *self._last[: KEPT_PLACES - 1]]
        return places

    def _find(self, pose: np.ndarray) -> FramePlaces:
        count = len(self.names)
        turn, shift = np.empty((count, 3, 3)), np.empty((count, 3))
        for number, (translation, rotation) in enumerate(pose):
            turn[number] = own = rotation_from_vector(rotation)
            pivot = self.pivot[number]
            shift[number] = (pivot - own @ pivot if rotation.any() else 0.0) + translation
            above = self.parent[number]
            if above >= 0:
                turn[number] = turn[above] @ own
                shift[number] = turn[above] @ shift[number] + shift[above]
        return FramePlaces(turn, shift)

    def pivots(self, places: FramePlaces) -> np.ndarray:
        """Where the pivots are [mm], shape (frame_count, 3)."""
        pivots: np.ndarray = np.einsum("fij,fj->fi", places.turn, self.pivot) + places.shift
        return pivots


@dataclass(frozen=True)
class RigidBody:
    """Constants of one rigid body; its frame has its origin in the centre of mass.

    Attributes:
        name: the body's name in the scene.
        vertices: of its surface in the body frame [mm], shape (vertex_count, 3).
        triangles: vertex indices, outward, shape (triangle_count, 3).
        shape: the shape that touches others in the place of its triangles, about the point -centre_of_mass.
        mass: [kg].
        inertia: about the centre of mass in the body frame [kg mm^2], shape (3, 3).
        centre_of_mass: in the coordinates of the scaled surface [mm], shape (3,).
        start_position: centre of mass at the start [mm], shape (3,).
        start_rotation: unit quaternion (w, x, y, z) at the start.
        start_velocity: [mm/s], shape (3,).
        start_angular_velocity: [rad/s], shape (3,).
        collides: whether it touches other bodies.
        groups: surfaces that have one in common do not touch each other.
        smooth: whether the surface stands for a curved one.
        springs: what holds it, or None.
        follows: frame that carries it, or None; mass and inertia then mean nothing.
    """

    name: str
    vertices: np.ndarray
    triangles: np.ndarray
    shape: RoundShape | None
    mass: float
    inertia: np.ndarray
    centre_of_mass: np.ndarray
    start_position: np.ndarray
    start_rotation: np.ndarray
    start_velocity: np.ndarray
    start_angular_velocity: np.ndarray
    collides: bool = True
    groups: frozenset[int] = frozenset()
    smooth: bool = False
    springs: settings.RigidSpringsSettings | None = None
    follows: str | None = None

    @property
    def radius(self) -> float:
        """Distance of its farthest point from the centre of mass, or a little more [mm]."""
        if self.shape is not None:
            return float(np.linalg.norm(self.centre_of_mass)) + 0.5 * self.shape.length + self.shape.radius
        return float(np.linalg.norm(self.vertices, axis=1).max())


@dataclass(frozen=True)
class Obstacle:
    """Something static: a surface (vertices and triangles), or an infinite plane (point and unit normal).

    A round shape touches others in the place of its triangles; a smooth surface stands for a curved one. What is at x
    in the coordinates of its scaled surface stands at turn @ x + shift.
    """

    name: str
    vertices: np.ndarray | None = None
    triangles: np.ndarray | None = None
    point: np.ndarray | None = None
    normal: np.ndarray | None = None
    shape: RoundShape | None = None
    groups: frozenset[int] = frozenset()
    smooth: bool = False
    turn: np.ndarray = field(default_factory=lambda: np.eye(3))
    shift: np.ndarray = field(default_factory=lambda: np.zeros(3))


ROUNDING = 1e-6
"""Relative error of an inertia that was written with a few digits."""
BOX_VERTICES = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
"""Corners of a cube of length 1, shape (8, 3)."""
BOX_TRIANGLES = np.array(
    [
        *([1, 3, 0], [4, 1, 0], [0, 3, 2], [2, 4, 0], [1, 7, 3], [5, 1, 4]),
        *([5, 7, 1], [3, 7, 2], [6, 4, 2], [2, 7, 6], [6, 5, 4], [7, 5, 6]),
    ]
)
"""Its outward triangles, shape (12, 3)."""


def make_rigid_body(name: str, body: settings.RigidBodySettings) -> RigidBody:
    """Compute a rigid body from its table in the scene."""
    if body.follows is not None:
        body = body.model_copy(update={"density": 1e-6})
    shape = round_shape(body)
    vertices, triangles = _surface(body, shape)
    is_open = body.follows is not None and _encloses_nothing(vertices, triangles)
    if body.surface is not None:
        triangles = triangles if is_open else closed_outward(vertices, triangles, body.surface)
    if body.smooth:
        refuse_unsmooth(vertices, triangles, f"rigid_bodies.{name}.smooth = true")
    mass, centre, inertia = 1.0, np.zeros(3), np.eye(3)
    if not is_open:
        mass, centre, inertia = _mass_properties(body, shape, vertices, triangles)
    if body.follows is not None:
        mass, inertia = 1.0, np.eye(3)  # they mean nothing, so that a surface need not be that of a solid
    if not np.allclose(inertia, inertia.T) or np.linalg.eigvalsh(inertia)[0] <= 0.0:
        raise SceneError(f"rigid_bodies.{name}.inertia = {inertia.tolist()}: must be symmetric and positive definite")
    first, second, third = np.linalg.eigvalsh(inertia)
    if third > (first + second) * (1.0 + ROUNDING):
        raise SceneError(
            f"rigid_bodies.{name}.inertia = {inertia.tolist()}: no body has it; the largest principal moment, "
            f"{third:g} kg mm^2, must not exceed the sum of the others, {first + second:g}"
        )
    turn = rotation_from_degrees(body.rotation)
    return RigidBody(
        name=name,
        vertices=vertices - centre,
        triangles=triangles.astype(np.int32),
        shape=shape,
        mass=mass,
        inertia=inertia,
        centre_of_mass=centre,
        start_position=np.asarray(body.position) + turn @ centre,
        start_rotation=quaternion_from_matrix(turn),
        start_velocity=np.array(body.velocity),
        start_angular_velocity=np.array(body.angular_velocity),
        collides=body.collides,
        groups=frozenset(body.groups),
        smooth=body.smooth,
        springs=body.springs,
        follows=body.follows,
    )


def make_obstacle(name: str, obstacle: settings.ObstacleSettings) -> Obstacle:
    """Compute an obstacle from its table in the scene, whose surface need not be closed."""
    if obstacle.plane is not None:
        normal = np.array(obstacle.plane.normal)
        return Obstacle(name, point=np.array(obstacle.plane.point), normal=normal / np.linalg.norm(normal))
    shape = round_shape(obstacle)
    vertices, triangles = _surface(obstacle, shape)
    if obstacle.surface is not None and count_open_edges(triangles) == 0:
        triangles = closed_outward(vertices, triangles, obstacle.surface)
    if obstacle.smooth:
        refuse_unsmooth(vertices, triangles, f"obstacles.{name}.smooth = true")
    turn, shift = rotation_from_degrees(obstacle.rotation), np.asarray(obstacle.translation)
    placed = vertices @ turn.T + shift
    return Obstacle(
        name,
        placed,
        triangles.astype(np.int32),
        shape=shape,
        groups=frozenset(obstacle.groups),
        smooth=obstacle.smooth,
        turn=turn,
        shift=shift,
    )


def _mass_properties(
    body: settings.RigidBodySettings, shape: RoundShape | None, vertices: np.ndarray, triangles: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass [kg], centre of mass [mm], shape (3,), and inertia about it [kg mm^2], shape (3, 3)."""
    if shape is not None:
        mass = body.mass if body.mass is not None else (body.density or 0.0) * shape.volume
        centre, inertia = np.zeros(3), shape.inertia(mass)
    else:
        volume, centre, inertia = volume_properties(vertices, triangles)
        density = body.density if body.density is not None else (body.mass or 0.0) / volume
        mass, inertia = density * volume, density * inertia
    if body.centre_of_mass is not None:
        centre = np.array(body.centre_of_mass)
    if body.inertia is not None:
        inertia = np.array(body.inertia)
    return mass, centre, inertia


def volume_properties(vertices: np.ndarray, triangles: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Volume [mm^3], centroid [mm], shape (3,), and inertia about it at density 1 [mm^5], shape (3, 3), of a solid.

    Each triangle makes a tetrahedron with a point inside, whose integral of x x^T is
    V / 20 (sum of c c^T over its corners c + s s^T), where s is the sum of the corners.
    """
    inside = vertices.mean(axis=0)
    corners = vertices[triangles] - inside
    volumes = np.linalg.det(corners) / 6.0
    volume, sums = volumes.sum(), corners.sum(axis=1)
    centroid = volumes @ sums / (4.0 * volume)
    second = np.einsum("t,tci,tcj->ij", volumes, corners, corners) + np.einsum("t,ti,tj->ij", volumes, sums, sums)
    second = second / 20.0 - volume * np.outer(centroid, centroid)
    return float(volume), inside + centroid, np.trace(second) * np.eye(3) - second


def _encloses_nothing(vertices: np.ndarray, triangles: np.ndarray) -> bool:
    """Whether a surface is open, or closed and flat."""
    volume, size = enclosed_volume(vertices, triangles), float(np.ptp(vertices, axis=0).max())
    return count_open_edges(triangles) > 0 or abs(volume) < ROUNDING * size**3


def _surface(
    body: settings.RigidBodySettings | settings.ObstacleSettings, shape: RoundShape | None
) -> tuple[np.ndarray, np.ndarray]:
    """Scaled vertices [mm], shape (vertex_count, 3), and triangles of a body or obstacle with this round shape."""
    if shape is not None:
        return shape.triangulated()
    if body.box is not None:
        return BOX_VERTICES * body.box, BOX_TRIANGLES
    vertices, triangles = read_surface(body.surface or "")
    return vertices * body.scale, triangles
