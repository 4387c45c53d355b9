"""Sections by a plane: triangles and tetrahedra cut in two, with what is given at their corners, and closed caps."""

import re
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Self

import numpy as np

from taichisoft.errors import MeshError

TERM = re.compile(r"([+-]?)(\d+\.?\d*|\.\d+)?\*?([xyz])")
PLANE = re.compile(r"([^<>=]+)([<>=])([+-]?[0-9.]+(?:e[+-]?\d+)?)")


@dataclass(frozen=True)
class SectionPlane:
    """A plane that cuts things in two; the part against the normal is kept.

    Attributes:
        normal: unit normal [-].
        offset: distance of the plane from the origin, along the normal [mm].
        is_turned: whether the plane turns its normal to whoever looks (`facing`).
    """

    normal: tuple[float, float, float]
    offset: float
    is_turned: bool

    @classmethod
    def parse(cls, text: str) -> Self:
        """The plane of "y=0", of which an eye sees the far part; "y<0" keeps this part; "x+2*y=30" is aslant [mm].

        Raises:
            MeshError: the text is written otherwise.
        """
        parts = PLANE.fullmatch(text.replace(" ", ""))
        terms = list(TERM.finditer(parts[1])) if parts else []
        normal = np.zeros(3)
        for term in terms:
            normal["xyz".index(term[3])] += float(f"{term[1]}{term[2] or 1}")
        try:
            offset = float(parts[3]) if parts else np.nan
        except ValueError:
            offset = np.nan
        length = float(np.linalg.norm(normal))
        if parts is None or "".join(term[0] for term in terms) != parts[1] or not length > 0 or not abs(offset) < 1e9:
            raise MeshError(f"section '{text}' must be a plane in mm, as y=0, z<12.5 (what is kept) or x+2*y=30")
        sign = -1.0 if parts[2] == ">" else 1.0
        x, y, z = (float(part) for part in sign * normal / length)
        return cls((x, y, z), sign * offset / length, parts[2] == "=")

    def facing(self, eye: np.ndarray) -> Self:
        """The plane with its normal towards an eye [mm], shape (3,), unless it says itself which part is kept."""
        if not self.is_turned or self.height(eye) >= 0.0:
            return self
        x, y, z = self.normal
        return replace(self, normal=(-x, -y, -z), offset=-self.offset)

    def height(self, points: np.ndarray) -> np.ndarray:
        """Distance of points [mm], shape (..., 3), from the plane, along its normal [mm], shape (...)."""
        return points @ np.array(self.normal) - self.offset


def split_triangles(corners: np.ndarray, height: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Split triangles where a quantity that is linear in them is zero.

    Args:
        corners: what belongs to each corner, positions and anything else that is linear, shape (count, 3, width).
        height: the quantity at the corners, shape (count, 3).

    Returns:
        Triangles where it is negative or zero, those where it is positive, each (.., 3, width), in the sense of the
        triangles that they come from; and the sides that they share, shape (.., 2, width).
    """
    above = height > 0.0
    count = above.sum(axis=1)
    parts = {False: [corners[count == 0]], True: [corners[count == 3]]}
    sides = [corners[:0, :2]]
    for number, alone in ((1, True), (2, False)):
        some = np.flatnonzero(count == number)
        turn = (np.argmax(above[some] == alone, axis=1)[:, None] + np.arange(3)) % 3  # the corner that is alone first
        a, b, c = np.moveaxis(corners[some[:, None], turn], 1, 0)
        ha, hb, hc = height[some[:, None], turn].T
        ab, ac = a + (ha / (ha - hb))[:, None] * (b - a), a + (ha / (ha - hc))[:, None] * (c - a)
        parts[alone].append(np.stack([a, ab, ac], axis=1))
        parts[not alone] += [np.stack([ab, b, c], axis=1), np.stack([ab, c, ac], axis=1)]
        sides.append(np.stack([ab, ac], axis=1))
    return np.concatenate(parts[False]), np.concatenate(parts[True]), np.concatenate(sides)


def cut_tetrahedra(
    corners: np.ndarray, height: np.ndarray, normal: tuple[float, float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """The section of tetrahedra by the plane where a quantity that is linear in them is zero.

    Args:
        corners: what belongs to each corner, the position [mm] first, shape (count, 4, width).
        height: the quantity at the corners, such as the distance from the plane, shape (count, 4).
        normal: unit normal of the plane, to which the triangles turn their front.

    Returns:
        Triangles with what is interpolated at their corners, shape (.., 3, width), and the tetrahedron of each, (..,).
    """
    above = height > 0.0
    count = above.sum(axis=1)
    cut = np.flatnonzero((count > 0) & (count < 4))
    order = np.argsort(above[cut] == (count[cut] < 3)[:, None], axis=1, kind="stable")[:, ::-1]
    points, heights = corners[cut[:, None], order], height[cut[:, None], order]

    def crossing(some: np.ndarray, first: int, second: int) -> np.ndarray:
        share = heights[some, first] / (heights[some, first] - heights[some, second])
        start: np.ndarray = points[some, first]
        return start + share[:, None] * (points[some, second] - start)

    halves = count[cut] == 2  # two corners on either side: a quadrilateral; else the first one is alone
    one, two = np.flatnonzero(~halves), np.flatnonzero(halves)
    tips = [crossing(one, 0, second) for second in (1, 2, 3)]
    ring = [crossing(two, *edge) for edge in ((0, 2), (0, 3), (1, 3), (1, 2))]
    triangles = np.concatenate(
        [np.stack(tips, axis=1), np.stack(ring[:3], axis=1), np.stack([ring[0], ring[2], ring[3]], axis=1)]
    )
    return facing_triangles(triangles, normal), np.concatenate([cut[one], cut[two], cut[two]])


def closed_cap(sides: np.ndarray, normal: tuple[float, float, float]) -> np.ndarray:
    """Fill the outline that a plane cuts out of closed surfaces, by the even-odd rule: also outlines within others.

    The outline is divided into trapezoids between the heights of its corners, so that nothing need be said about how
    its sides follow each other.

    Args:
        sides: the sides of the outline, in any order [mm], shape (side_count, 2, 3).
        normal: unit normal of the plane, to which the triangles turn their front.

    Returns:
        Corners of triangles [mm], shape (.., 3, 3).
    """
    if not len(sides):
        return np.zeros((0, 3, 3))
    axes = np.linalg.svd(np.array(normal)[None])[2]
    across, along, through = axes[1], axes[2], axes[0]
    x, y = sides @ across, sides @ along
    depth = float((sides @ through).mean())
    levels = np.unique(np.round(y, 7))
    trapezoids = []
    for low, high in pairwise(levels):
        some = np.flatnonzero((y.min(axis=1) < (low + high) / 2) & (y.max(axis=1) > (low + high) / 2))
        slope = (x[some, 1] - x[some, 0]) / (y[some, 1] - y[some, 0])
        at_low, at_high = (x[some, 0] + slope * (level - y[some, 0]) for level in (low, high))
        order = np.argsort(at_low + at_high)[: len(some) // 2 * 2]
        left, right = order[::2], order[1::2]
        for first, second, third in (
            ((at_low[left], low), (at_low[right], low), (at_high[right], high)),
            ((at_low[left], low), (at_high[right], high), (at_high[left], high)),
        ):
            corners = [where[:, None] * across + level * along for where, level in (first, second, third)]
            trapezoids.append(np.stack(corners, axis=1) + depth * through)
    return facing_triangles(np.concatenate(trapezoids), normal) if trapezoids else np.zeros((0, 3, 3))


def facing_triangles(corners: np.ndarray, normal: tuple[float, float, float]) -> np.ndarray:
    """Triangles, the position first at each corner, (count, 3, width), turned so that they show their front."""
    a, b, c = np.moveaxis(corners[..., :3], 1, 0)
    turned = np.cross(b - a, c - a) @ np.array(normal) < 0.0
    return np.where(turned[:, None, None], corners[:, ::-1], corners)
