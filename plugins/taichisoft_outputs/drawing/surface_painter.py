"""Surfaces over a background: their normals and light, layers from the farthest to the nearest, and sections."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_erosion, label, maximum_filter, uniform_filter

from taichisoft import Scene
from taichisoft.mesh import (
    SectionPlane,
    closed_cap,
    cut_tetrahedra,
    split_triangles,
)
from taichisoft_outputs.drawing.camera import PictureCamera, project, scene_axes, seen_from_front
from taichisoft_outputs.drawing.colouring import ColourScale
from taichisoft_outputs.drawing.stage import EMPTY, Stage
from taichisoft_outputs.drawing.style import StyleError
from taichisoft_outputs.recording.bodies import RecordedSurface
from taichisoft_outputs.recording.reader import Recording

# Smooth normals of surfaces, and how bright a surface is where its normal points.
#
# There is a high key light, and light from all around, more of it from above.

KEY_LIGHT = (0.55, 0.75, 1.25)
"""Direction to the usual key light in the axes (right, front, up) of `camera.scene_axes`: in front, from the right."""

DARKEST, KEY_STRENGTH, SKY_STRENGTH = 0.44, 0.44, 0.12
"""Brightness of what is turned away, and what the two lights add at most; together 1 [-]."""


CREASE_ANGLE = 40.0
"""Faces that meet at a sharper angle [degrees] keep the edge between them."""


class SmoothNormals:
    """Gives every triangle corner a vertex and a normal of its own, as its surface deforms.

    The normal of a corner is the area-weighted mean of the triangles at its vertex that are turned by less than
    CREASE_ANGLE against its own triangle: curved faces are smooth, and edges stay sharp.
    """

    def __init__(self, triangles: np.ndarray):
        self._triangles = triangles
        # The pairs do not change while the surface deforms; finding them takes longer than all the rest.
        self._corners, others = corners_at_same_vertex(triangles.ravel())
        self._own, self._other = self._corners // 3, others // 3

    def __call__(self, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Corners and normals for vertices [mm] of shape (vertex_count, 3).

        Returns:
            Corner positions [mm] and unit normals, each (3 * triangle_count, 3); corner 3 i + k is corner k of
            triangle i.
        """
        corners = vertices[self._triangles]
        areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        smooth = face_alike(areas, self._own, self._other)
        where, what = self._corners[smooth], areas[self._other[smooth]]
        normals = np.stack([np.bincount(where, part, self._triangles.size) for part in what.T], axis=1)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        return corners.reshape(-1, 3), normals / np.maximum(lengths, 1e-30)


def split_creases(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give a vertex on a crease one copy per smooth part of the surface around it.

    A surface that deforms is split once; copy i is then always where vertex `source[i]` is.

    Returns:
        `source`, vertex of each copy, shape (copy_count,), and triangles of copies, shape (triangle_count, 3).
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    corners = vertices[triangles]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    one, other = corners_at_same_vertex(triangles.ravel())
    smooth = face_alike(areas, one // 3, other // 3)
    joined = coo_matrix((np.ones(smooth.sum()), (one[smooth], other[smooth])), shape=(triangles.size, triangles.size))
    count, copy = connected_components(joined, directed=False)
    source = np.empty(count, dtype=np.int64)
    source[copy] = triangles.ravel()
    return source, copy.reshape(-1, 3)


def face_alike(areas: np.ndarray, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Whether triangles `one` and `other`, shape (count,), are turned against each other by less than CREASE_ANGLE.

    Args:
        areas: a vector along the normal of each triangle, of any length, shape (triangle_count, 3).
    """
    units = areas / np.maximum(np.linalg.norm(areas, axis=1, keepdims=True), 1e-30)
    return np.einsum("ij,ij->i", units[one], units[other]) > np.cos(np.radians(CREASE_ANGLE))


def corners_at_same_vertex(vertex_of_corner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All ordered pairs of corners that share a vertex, each corner with itself too."""
    from scipy.sparse import csr_array

    count = len(vertex_of_corner)
    corners = csr_array((np.ones(count), (np.arange(count), vertex_of_corner)))
    one, other = (corners @ corners.T).nonzero()
    return one, other


def key_light(scene: Scene) -> np.ndarray:
    """Unit vector to the key light of a scene, shape (3,)."""
    chosen = scene.appearance.light
    key = np.array(KEY_LIGHT) @ scene_axes(scene.up) if chosen is None else np.array(chosen)
    return key / np.linalg.norm(key)


def shade(colours: np.ndarray, normals: np.ndarray, key: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Colours as they appear in the light, shape (count, 3)."""
    # Half of the light reaches around what it falls on, so that no side that is turned away looks flat.
    from_key = (0.5 + 0.5 * normals @ key) ** 1.5
    from_sky = 0.5 + 0.5 * normals @ up
    return colours * (DARKEST + KEY_STRENGTH * from_key + SKY_STRENGTH * from_sky)[:, None]


# Opaque surfaces over a background, and translucent bodies in layers from the farthest to the nearest.

HOLDOUT = " as a holdout"
"""Ends the name of what is drawn in the colour EMPTY, so that it hides parts of a layer without being seen in it."""

NUMBERED = " by its number"
"""Ends the name of what is drawn in a colour that stands for its number."""


NORMALS = " by its normals"
"""Ends the name of what is drawn in colours that say where its normals point, so that its edges can be found."""
LINE_ANGLE = 30.0
"""Normals of neighbouring pixels that differ by more have a line between them [degrees]."""
LINE_PER_HEIGHT = 720
"""A line is one pixel wide for each so many in the height of a picture, but at least one."""
FADING = (1, 2, 3)
"""Distances from the outline in which a line becomes darker, step by step [widths of a line]."""
SHORTEST_LINE = 8
"""Length of a line [its widths]: shorter ones are specks, where something is seen through the joint of two faces."""
LINE_BRIGHTNESS = 0.55
"""Part of its colour that a surface has in such a line [-]."""


@dataclass(frozen=True)
class Section:
    """Bodies cut open.

    Attributes:
        plane: the plane that cuts them; what is on the side of its normal is left out.
        names: of the surfaces that are cut.
        hollow: of those of them that show their far walls from inside.
        caps: of some of them, corners of the triangles that close them [mm], shape (count, 3, 3), with a value at each
            corner as a fourth number where the surface has values.
    """

    plane: SectionPlane
    names: frozenset[str]
    hollow: frozenset[str]
    caps: Mapping[str, np.ndarray]


class SurfacePainter:
    """Paints surfaces that deform; a process can have only one.

    Args:
        unlit: names of the surfaces whose colours stand for numbers, which get no light, and whether they get lines
            along their edges.
        within: names of the surfaces within soft bodies, which are seen through these where they are unlit.
        scale: the colours of surfaces that have values.
    """

    def __init__(
        self,
        size: tuple[int, int],
        triangles: dict[str, np.ndarray],
        translucent: Sequence[str],
        opacity: float,
        key: np.ndarray,
        up: np.ndarray,
        unlit: Mapping[str, bool],
        within: Sequence[str],
        scale: ColourScale | None = None,
    ):
        self._size, self._opacity, self._key, self._up = size, opacity, key, up
        self._unlit, self._scale = unlit, scale
        self._normals = {name: SmoothNormals(of_surface) for name, of_surface in triangles.items()}
        self._triangles = triangles
        self._translucent = list(translucent) if opacity < 1.0 else []
        # Silicone would move colours off the bar: what shows numbers within it is drawn over it.
        self._above = [name for name in within if name in unlit and self._translucent]
        self._opaque = [name for name in triangles if name not in (*self._translucent, *self._above)]
        self._always: list[str] = []
        self._stage = Stage(size)

    def hide_behind(self, name: str, vertices: np.ndarray, triangles: np.ndarray) -> None:
        """Let nothing be seen behind triangles that are painted elsewhere."""
        self._put_holdout(name + HOLDOUT, vertices, triangles)
        self._always.append(name + HOLDOUT)

    def paint(
        self,
        picture: np.ndarray,
        camera: PictureCamera,
        vertices: dict[str, np.ndarray],
        colours: dict[str, np.ndarray],
        section: Section | None = None,
    ) -> np.ndarray:
        """The picture with all surfaces over it.

        Args:
            colours: red, green and blue [-] of every surface, shape (3,), or of its vertices, (vertex_count, 3); or
                values of `scale` at the corners of its triangles, (3 * triangle_count, 1).
        """
        for name, where in vertices.items():
            self._put(name, camera, where, colours[name], section)
        holdouts = [name + HOLDOUT for name in self._opaque] + self._always
        picture = self._laid_over(picture, camera, self._opaque, holdouts, 1.0)
        bodies = [vertices[name] for name in self._translucent]
        for layer in depth_layers(bodies, camera, self._size):
            names = [self._translucent[body] for body in layer]
            picture = self._laid_over(picture, camera, names, holdouts, self._opacity)
        return self._laid_over(picture, camera, self._above, holdouts, 1.0) if self._above else picture

    def _laid_over(
        self, picture: np.ndarray, camera: PictureCamera, names: list[str], holdouts: list[str], opacity: float
    ) -> np.ndarray:
        """The picture with surfaces over it, and with lines along the edges of the unlit ones."""
        image = self._stage.image(
            camera, [*names, *(one for one in holdouts if one.removesuffix(HOLDOUT) not in names)]
        )
        unlit = [name for name in names if self._unlit.get(name)]
        if unlit:
            others = [one for one in holdouts if one.removesuffix(HOLDOUT) not in unlit]
            draw_lines(image, self._stage.image(camera, [name + NORMALS for name in unlit] + others))
        return lay_over(picture, image, opacity)

    def _put(
        self,
        name: str,
        camera: PictureCamera,
        vertices: np.ndarray,
        colours: np.ndarray,
        section: Section | None,
    ) -> None:
        corners, normals = self._normals[name](vertices)
        if colours.ndim == 1:
            at_corners = np.tile(colours, (len(corners), 1))
        else:
            at_corners = colours if colours.shape[1] == 1 else colours[self._triangles[name].ravel()]
        soup = np.concatenate([corners, normals, at_corners], axis=1).reshape(-1, 3, 6 + at_corners.shape[1])
        if section is not None and name in section.names:
            soup, _, _ = split_triangles(soup, section.plane.height(soup[..., :3]))
            if name in section.hollow:
                soup = soup[:, ::-1]
                soup[..., 3:6] *= -1.0
            cap = section.caps.get(name, np.zeros((0, 3, 3)))
            of_cap = np.empty((len(cap), *soup.shape[1:]))
            of_cap[..., :3], of_cap[..., 3:6] = cap[..., :3], section.plane.normal
            of_cap[..., 6:] = cap[..., 3:] if colours.ndim == 2 else colours
            soup = np.concatenate([soup, of_cap])
        if at_corners.shape[1] == 1:
            assert self._scale is not None
            for stop in self._scale.stops:  # between two of which colours are linear, in the renderer as on the bar
                below, above, _ = split_triangles(soup, soup[..., 6] - stop)
                soup = np.concatenate([below, above])
        soup = soup[seen_from_front(camera, soup[..., :3])]
        flat = soup.reshape(-1, soup.shape[2])
        corners, normals, shown = flat[:, :3], flat[:, 3:6], flat[:, 6:]
        if self._scale is not None and at_corners.shape[1] == 1:
            shown = self._scale.colours(shown[:, 0])
        triangles = np.arange(len(corners)).reshape(-1, 3)
        if name in self._unlit:
            self._stage.put(name + NORMALS, corners, triangles, 0.5 + 0.5 * normals)
        else:
            shown = shade(shown, normals, self._key, self._up)
        self._stage.put(name, corners, triangles, shown)
        if name in self._opaque:
            self._put_holdout(name + HOLDOUT, corners, triangles)

    def measure(
        self, camera: PictureCamera, vertices: dict[str, np.ndarray], numbers: dict[str, int]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Depth [mm], infinite where nothing is, and the number of what is seen, -1 for nothing, (height, width) both.

        Args:
            numbers: number of each surface that counts, from 0 to 253, by name.
        """
        for name, number in numbers.items():
            colour = np.array([(number + 1) / 255, 0.0, 0.0])
            self._stage.put(
                name + NUMBERED, vertices[name], self._triangles[name], np.tile(colour, (len(vertices[name]), 1))
            )
        visible = [name + NUMBERED for name in numbers]
        picture = self._stage.image(camera, visible)
        found = np.where(picture[..., 2] == 0, picture[..., 0].astype(np.int32) - 1, -1)
        return self._stage.depth(camera, visible), found

    def _put_holdout(self, name: str, vertices: np.ndarray, triangles: np.ndarray) -> None:
        self._stage.put(name, vertices, triangles, np.tile(np.array(EMPTY) / 255, (len(vertices), 1)))


def draw_lines(image: np.ndarray, normals: np.ndarray) -> None:
    """Draw lines into a picture, EMPTY where nothing is, along the edges of what its picture of normals shows."""
    lines = lines_between(normals)
    here = (lines > 0.0) & (image != np.array(EMPTY, dtype=np.uint8)).any(axis=2)
    image[here] = np.rint((1.0 - (1.0 - LINE_BRIGHTNESS) * lines[here, None]) * image[here])


def lines_between(normals: np.ndarray) -> np.ndarray:
    """How dark the lines are in a picture of normals where these differ, 0 to 1, shape (height, width).

    They have soft sides, and fade towards the outline: a face that is seen edge-on, here one pixel wide and there two,
    would have a line of dashes.

    Args:
        normals: picture of (1 + normal) / 2, EMPTY where nothing is, shape (height, width, 3), dtype uint8.
    """
    covered = (normals != np.array(EMPTY, dtype=np.uint8)).any(axis=2)
    rows, columns = np.flatnonzero(covered.any(axis=1)), np.flatnonzero(covered.any(axis=0))
    lines = np.zeros(covered.shape, dtype=np.float32)
    if not len(rows):
        return lines
    part = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    directions = normals[part].astype(np.float32) / 127.5 - 1.0
    width = max(normals.shape[0] // LINE_PER_HEIGHT, 1)
    inner, edges = covered[part], np.zeros(directions.shape[:2], dtype=bool)
    for before, after in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        cosine = np.einsum("ijk,ijk->ij", directions[before], directions[after])
        edges[after] |= (cosine < np.cos(np.radians(LINE_ANGLE))) & inner[before] & inner[after]
    pieces, _ = label(edges, np.ones((3, 3)))
    edges &= np.bincount(pieces.ravel())[pieces] >= SHORTEST_LINE * width
    depth = sum(binary_erosion(inner, iterations=step * width).astype(np.float32) for step in FADING)
    soft = uniform_filter(maximum_filter(edges * depth / len(FADING), size=width), size=width + 1)
    lines[part] = np.minimum(1.5 * soft, 1.0)
    return lines


def depth_layers(bodies: Sequence[np.ndarray], camera: PictureCamera, size: tuple[int, int]) -> list[list[int]]:
    """Indices of bodies from the farthest layer to the nearest; in no layer does one stand before another.

    Two bodies may share a layer where their rectangles in the picture do not touch, so mostly few layers are needed.
    """
    rectangles, distances = [], []
    for vertices in bodies:
        pixels, depth = project(camera, vertices, size)
        rectangles.append((pixels.min(axis=0), pixels.max(axis=0)))
        distances.append(depth.mean())
    layers: list[list[int]] = []
    layer_of: dict[int, int] = {}
    for index in sorted(range(len(bodies)), key=lambda body: -distances[body]):
        low, high = rectangles[index]
        behind = [
            layer
            for other, layer in layer_of.items()
            if (low <= rectangles[other][1]).all() and (rectangles[other][0] <= high).all()
        ]
        layer_of[index] = max(behind, default=-1) + 1
        if layer_of[index] == len(layers):
            layers.append([])
        layers[layer_of[index]].append(index)
    return layers


def lay_over(below: np.ndarray, layer: np.ndarray, opacity: float) -> np.ndarray:
    """A picture with a layer over it, where that shows something.

    Args:
        layer: picture of the layer, EMPTY where there is nothing in it.
    """
    from PIL import Image

    red, green, blue = EMPTY
    # Channel by channel, and only where there is something: this is done for every pixel of a video.
    covered = (layer[..., 1] != green) | (layer[..., 0] != red) | (layer[..., 2] != blue)
    mask = Image.fromarray(covered)
    box = mask.getbbox()
    if box is None:
        return below
    part = np.s_[box[1] : box[3], box[0] : box[2]]
    bottom, top = Image.fromarray(below[part]), Image.fromarray(layer[part])
    bottom.paste(top if opacity == 1.0 else Image.blend(bottom, top, opacity), mask=mask.crop(box))
    over = below.copy()
    over[part] = np.asarray(bottom)
    return over


# The bodies of a recording cut open by a plane: which surfaces are cut, and what closes them.


def refuse_what_cuts_nothing(section: str, points: np.ndarray) -> None:
    """Check that a plane, "y=0", has something on both sides."""
    height = SectionPlane.parse(section).height(points)
    if not height.min() < 0.0 < height.max():
        lower, upper = (np.round(end(points, axis=0), 1).tolist() for end in (np.min, np.max))
        raise StyleError(f"section '{section}' cuts nothing; what is drawn spans {lower} to {upper} mm")


def cut_open(
    recording: Recording,
    surfaces: Sequence[RecordedSurface],
    instant: int,
    plane: SectionPlane,
    values: np.ndarray | None = None,
) -> Section:
    """Cut what moves and the obstacles: silicone shows its elements' section, rigid bodies are filled, air is hollow.

    Cables, and planes without an end, stay whole.

    Args:
        surfaces: its surfaces, or finer ones in their place.
        plane: the plane, whose normal points to what is left out.
        values: values at the nodes of all soft bodies by material, which the section shows (`NodeValues`); or None.
    """
    caps = {}
    position = recording.row("position", instant)
    for body in recording.soft_bodies:
        corners = position[body.nodes][body.tetrahedra]
        if values is not None:
            material = np.repeat(body.material, body.parts) if values.shape[1] > 1 else np.zeros(len(corners), int)
            of_corners = values[body.nodes][body.tetrahedra, material[:, None]]
            corners = np.concatenate([corners, of_corners[..., None]], axis=2)
        caps[body.name] = cut_tetrahedra(corners, plane.height(corners[..., :3]), plane.normal)[0]
    cut = [surface for surface in surfaces if surface.kind != "line"]
    for surface in cut:
        if surface.kind not in ("soft", "cavity"):
            corners = surface.vertices(instant)[surface.triangles]
            _, _, sides = split_triangles(corners, plane.height(corners))
            caps[surface.name] = closed_cap(sides, plane.normal)
    hollow = frozenset(surface.name for surface in cut if surface.kind == "cavity")
    return Section(plane, frozenset(surface.name for surface in cut), hollow, caps)
