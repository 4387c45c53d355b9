"""The round shapes of all bodies in one set of arrays."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taichisoft.bodies.closed_form_shapes import RoundShape
from taichisoft.bodies.rigid_body_arrays import Obstacle, RigidBody
from taichisoft.contact.kernels.round_shapes import SURFACE_PAIR_COLUMNS, MovedShapes, RoundShapes
from taichisoft.contact.kernels.shape_distance import FACING
from taichisoft.runtime.language import STATIC
from taichisoft.state import State

# A load leans to one side if it goes through an end farther from the axis than this fraction of the radius.
CLEAR_LEAN = 0.5


@dataclass(frozen=True)
class RoundPart:
    """One shape before it is joined with the others.

    Attributes:
        body: number of its body.
        owner: number of the rigid body that carries the shape, or STATIC.
        shape: kind and dimensions.
        centre, turn: position and rotation, on a rigid body in body axes from the centre of mass, else in the world,
            shapes (3,) [mm] and (3, 3).
        groups: parts with a common group do not touch each other.
        collides: False: touches no other part.
    """

    body: int
    owner: int
    shape: RoundShape
    centre: np.ndarray
    turn: np.ndarray
    groups: frozenset[int]
    collides: bool


def round_parts(first_body: int, rigid: Sequence[RigidBody], obstacles: Sequence[Obstacle]) -> list[RoundPart]:
    """Round shapes of the rigid bodies and obstacles; `first_body` is the number of the first rigid body."""
    parts = []
    for index, body in enumerate(rigid):
        if body.shape is not None:
            parts.append(
                RoundPart(
                    first_body + index, index, body.shape, -body.centre_of_mass, np.eye(3), body.groups, body.collides
                )
            )
    for index, obstacle in enumerate(obstacles, start=first_body + len(rigid)):
        if obstacle.shape is not None:
            parts.append(
                RoundPart(index, STATIC, obstacle.shape, obstacle.shift, obstacle.turn, obstacle.groups, collides=True)
            )
    return parts


def join_shapes(
    parts: Sequence[RoundPart], surface_pairs: Sequence[tuple[int, int, bool]], shape_pairs: Sequence[tuple[int, int]]
) -> RoundShapes:
    """Join shapes in one set of arrays.

    Args:
        parts: the shapes.
        surface_pairs: numbers of a shape and of a surface that can touch, and whether the surface is soft.
        shape_pairs: numbers of two shapes that can touch.
    """
    turns = np.array([part.turn for part in parts]).reshape(-1, 3, 3)
    moves = np.array([part.owner != STATIC and part.collides for part in parts], dtype=bool)
    return RoundShapes(
        body=np.array([part.body for part in parts], dtype=np.int32),
        owner=np.array([part.owner for part in parts], dtype=np.int32),
        flat=np.array([part.shape.flat for part in parts], dtype=np.int32),
        radius=np.array([part.shape.radius for part in parts], dtype=float),
        half_length=np.array([0.5 * part.shape.length for part in parts], dtype=float),
        local_centre=np.array([part.centre for part in parts], dtype=float).reshape(-1, 3),
        local_axis=turns[:, :, 2].copy(),
        local_side=turns[:, :, 0].copy(),
        moving=np.flatnonzero(moves).astype(np.int32),
        surface_pairs=np.array(surface_pairs, dtype=np.int32).reshape(-1, SURFACE_PAIR_COLUMNS),
        shape_pairs=np.array(shape_pairs, dtype=np.int32).reshape(-1, 2),
    )


def moved_shapes(shapes: RoundShapes) -> MovedShapes:
    """Arrays of current positions: shapes of obstacles in place, other shapes in body axes."""
    lean = np.repeat(shapes.local_side[:, None], 2, axis=1)
    return MovedShapes(shapes.local_centre.copy(), shapes.local_axis.copy(), shapes.local_side.copy(), lean)


def update_lean(shapes: RoundShapes, there: MovedShapes, state: State) -> None:
    """Align the division of cylinder rims with the load in the step that led to `state`.

    On the edge of tipping the load goes through one point of the rim, which must then be a contact. A load near the
    middle has no clear direction: then the division is fixed on the cylinder.
    """
    pressing = np.abs((state.contact_impulse * state.contact_normal).sum(axis=1))
    for shape in np.flatnonzero(shapes.flat).tolist():
        axis, centre = there.axis[shape], there.centre[shape]
        mine = (state.contact_body_pair == shapes.body[shape]).any(axis=1)
        mine &= np.abs(state.contact_normal @ axis) > FACING
        arms = state.contact_point - centre
        for end, on_end in enumerate((arms @ axis < 0.0, arms @ axis >= 0.0)):
            weights = np.where(mine & on_end, pressing, 0.0)
            offset = weights @ arms / max(weights.sum(), 1e-300)
            offset -= offset @ axis * axis
            length = float(np.linalg.norm(offset))
            clear = length > CLEAR_LEAN * shapes.radius[shape]
            there.lean[shape, end] = offset / length if clear else there.side[shape]


def boxes(shapes: RoundShapes, there: MovedShapes) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corners of the bounding boxes of shapes [mm], each (shape_count, 3)."""
    extent = shapes.half_length[:, None] * np.abs(there.axis) + shapes.radius[:, None]
    return there.centre - extent, there.centre + extent
