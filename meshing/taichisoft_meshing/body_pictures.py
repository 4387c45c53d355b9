"""Pictures and tables of bodies: their numbered faces, and the parts of a mould."""

from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Group

from taichisoft.base import WorkerLost, atomic_file, call_apart, require
from taichisoft.errors import MeshError
from taichisoft_meshing.cad_body import CadBody
from taichisoft_meshing.closed_shells import area_vectors
from taichisoft_meshing.mesh_quality import aligned_table
from taichisoft_meshing.mould_check import CheckedPart, ray_crossings

# The tables that `taichisoft mesh info` prints of a body from CAD.


def body_tables(body: CadBody) -> Group:
    """The solids of a body from CAD, its faces with the numbers that geometry files name, its cavities and openings."""

    def place(point: np.ndarray) -> str:
        return ", ".join(f"{value:.4g}" for value in np.round(point, 3) + 0.0)

    solids = [(f"{part.number}", part.name, f"{part.volume:.1f}") for part in body.solids]
    of_void = {face: f"cavity {number}" for number, void in enumerate(body.voids, 1) for face in void}
    of_void |= {face: f"opening {number}" for number, part in enumerate(body.openings, 1) for face in part.faces}
    of_void |= dict.fromkeys(body.flat_end, "base, unless another is named")
    faces = [
        (
            f"{face.number}",
            " | ".join(map(str, face.solids)),
            f"{face.area:.1f}",
            place(face.centre),
            "curved" if face.normal is None else place(face.normal),
            of_void.get(face.number, ""),
        )
        for face in body.faces
    ]
    air = [(f"cavity {number}", f"{volume:.1f}", "closed") for number, volume in enumerate(body.void_volumes, 1)]
    air += [(f"opening {number}", f"{part.volume:.1f}", str(part)) for number, part in enumerate(body.openings, 1)]
    return Group(
        aligned_table(body.path.name, (">solid", "name", ">volume [mm³]"), solids),
        aligned_table("", (">face", "solids", ">area [mm²]", "centre [mm]", "normal", ""), faces),
        *([aligned_table("", ("air", ">volume [mm³]", ""), air)] * bool(air)),
    )


# A picture of each part of a mould, from both sides of its parting direction, with the places that the check found.

SIZE = (900, 640)
"""Width and height of each of the four views [pixels]."""
PRINTED, SILICONE, HELD, THIN = (0.55, 0.66, 0.76), (0.86, 0.80, 0.68), (0.80, 0.10, 0.10), (0.95, 0.60, 0.05)
"""Colours of what is printed and of silicone, of what an undercut holds, and of walls too thin to print."""
DEEP = 0.35
"""Part of the light that the lowest place gets less than the highest: it tells levels apart that face one way."""
INK, LETTERS = (0.1, 0.12, 0.14), 22.0
"""Colour [-] and height [pixels] of the letters."""
TIME_LIMIT = 300.0
"""Longest time that the pictures may take [s]."""


def draw_parts(parts: Sequence[CheckedPart]) -> list[Path]:
    """Draw each part to a PNG beside its STL file."""
    require("pictures of a mould", "open3d")
    from PIL import Image

    try:
        images = call_apart(
            "taichisoft_meshing.body_pictures:draw_views",
            [(part.corners, _colours(part), _parting(part, parts)) for part in parts],
            time_limit=TIME_LIMIT,
        )
    except (WorkerLost, OSError, RuntimeError) as error:
        raise MeshError(f"the parts cannot be drawn: {error}; `taichisoft doctor` says what is missing") from error
    from taichisoft_outputs.drawing.overlay import paint_caption

    files = [part.file.with_suffix(".png") for part in parts]
    for image, file, part in zip(images, files, parts, strict=True):
        picture = Image.fromarray(np.pad(image, ((round(2 * LETTERS), 0), (0, 0), (0, 0)), constant_values=255))
        size = " x ".join(f"{length:.1f}" for length in np.ptp(part.corners, axis=(0, 1)))
        paint_caption(
            picture, [file.stem, f"{size} mm", "from both sides, on the right along the parting"], INK, LETTERS
        )
        with atomic_file(file, MeshError) as partial:
            picture.save(partial, format="png")
    return files


def draw_views(parts: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> list[np.ndarray]:
    """What the drawing process does: four views of each part, aslant and along the parting, dtype uint8.

    Args:
        parts: corners [mm], shape (count, 3, 3), colours of the triangles [-], (count, 3), and the parting direction
            of each part, (3,).
    """
    from taichisoft_outputs.drawing.camera import fit_camera, scene_axes, seen_from_front
    from taichisoft_outputs.drawing.drawer import antialias
    from taichisoft_outputs.drawing.stage import EMPTY, Stage
    from taichisoft_outputs.drawing.surface_painter import KEY_LIGHT, draw_lines, shade

    stage = Stage(SIZE)  # a process can have only one
    images = []
    for corners, colours, parting in parts:
        normals = area_vectors(corners)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
        views = []
        for side, view in product((1.0, -1.0), ("iso", "top")):
            up = side * parting
            key = np.array(KEY_LIGHT) @ scene_axes(up)
            camera = fit_camera(corners.reshape(-1, 3), up, view, SIZE[0] / SIZE[1])
            front = seen_from_front(camera, corners)
            points, triangles = corners[front].reshape(-1, 3), np.arange(3 * front.sum()).reshape(-1, 3)
            shown = shade(colours[front], normals[front], key / np.linalg.norm(key), up)
            height = points @ up
            brightness = 1.0 - DEEP * (height.max() - height) / max(np.ptp(height), 1e-9)
            stage.put("part", points, triangles, np.repeat(shown, 3, axis=0) * brightness[:, None])
            stage.put("normals", points, triangles, np.repeat(0.5 + 0.5 * normals[front], 3, axis=0))
            image = stage.image(camera, ["part"])
            draw_lines(image, stage.image(camera, ["normals"]))
            image[(image == EMPTY).all(axis=2)] = 255
            views.append(antialias(image))
        images.append(np.concatenate([np.concatenate(views[row : row + 2], axis=1) for row in (0, 2)]))
    return images


def _parting(part: CheckedPart, parts: Sequence[CheckedPart]) -> np.ndarray:
    """The direction along which a part comes off, or others come off it."""
    ways = [one.comes_off for one in (part, *parts) if one.comes_off is not None]
    return np.array(ways[0]) if ways else np.array([0.0, 1.0, 0.0])


def _colours(part: CheckedPart) -> np.ndarray:
    colours = np.tile(PRINTED if part.printed else SILICONE, (len(part.corners), 1))
    colours[part.thin] = THIN
    for undercut in part.undercuts:
        colours[undercut.triangles] = HELD
    return colours


# The picture of a body from CAD with the numbers of its faces, seen from two opposite corners.

EYES = ((1.0, -1.4, 0.9), (-1.0, 1.4, -0.9))
"""Directions from the body to the two eyes: every face of a block is seen by one of them."""
VIEW = np.array([10.0, 4.8])
"""Width and height that a view takes at least [inches]."""
LABEL = np.array([24.0, 14.0])
"""Width and height of a number [points]."""
TRIED = 6  # triangles of a face, those near its middle and those near the eye, that are tried as its number's place


def draw_faces(body: CadBody, path: Path) -> None:
    """Draw a body with its faces in many colours, each with its number where it is seen."""
    require("a picture of faces", "matplotlib")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 11.0), dpi=110, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    for axes, eye in zip(figure.subplots(2, 1), EYES, strict=True):
        _draw(axes, body, np.array(eye))
    size = " x ".join(f"{length:.4g}" for length in body.extent)
    shown = {text.get_text() for axes in figure.axes for text in axes.texts}
    hidden = [str(face.number) for face in body.faces if str(face.number) not in shown]
    rest = f"; not seen: {', '.join(hidden)}" if hidden else ""
    figure.suptitle(f"{body.path.name}: {len(body.faces)} faces, {size} mm{rest}".replace("$", r"\$"), wrap=True)
    with atomic_file(path, MeshError) as partial:
        figure.savefig(partial, format="png", metadata={"Software": None})


def _draw(axes: Any, body: CadBody, eye: np.ndarray) -> None:
    from matplotlib import colormaps
    from matplotlib.collections import PolyCollection

    towards = eye / np.linalg.norm(eye)
    right = np.cross([0.0, 0.0, 1.0], towards)
    right /= np.linalg.norm(right)
    view = np.column_stack([right, np.cross(towards, right), towards])
    corners = (body.nodes @ view)[body.triangles]
    normals = area_vectors(corners)
    facing = normals[:, 2] / np.linalg.norm(normals, axis=1)
    skin = np.isin(body.face_of, list(body.outside))
    seen = np.flatnonzero(skin & (facing > 1e-6))
    seen = seen[np.argsort(corners[seen, :, 2].mean(axis=1), kind="stable")]
    colours = colormaps["tab20"]((body.face_of[seen] * 7 % 20) / 20 + 0.025)
    colours[:, :3] = 0.45 + 0.55 * colours[:, :3] * (0.6 + 0.4 * facing[seen, None])
    axes.add_collection(
        PolyCollection(list(corners[seen, :, :2]), facecolors=colours, edgecolors="face", linewidths=0.4)
    )
    axes.autoscale_view()
    axes.set(aspect="equal", xticks=[], yticks=[], frame_on=False)
    box = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.8}
    places = _visible_places(corners[seen], body.face_of[seen])
    extent = np.ptp(corners[seen, :, :2].reshape(-1, 2), axis=0)
    labels = labels_apart(list(places.values()), LABEL * (extent / (VIEW * 72.0)).max())
    for (face, place), label in zip(places.items(), labels, strict=True):
        if (label != place).any():
            axes.plot(*np.array([place, label]).T, "o-", color="#202020", linewidth=0.7, markersize=2.5, markevery=[0])
        axes.text(*label, str(face), ha="center", va="center", fontsize=9, bbox=box)
    span = np.ptp(corners[seen, :, :2].reshape(-1, 2), axis=0).max()
    origin = corners[seen, :, :2].reshape(-1, 2).min(axis=0) - 0.08 * span
    for name, axis in zip("xyz", view[:, :2], strict=True):
        ends = np.array([origin, origin + 0.08 * span * axis]).T
        axes.plot(*ends, color="#404040", linewidth=1.5)
        axes.text(*(origin + 0.1 * span * axis), name, color="#404040", ha="center", va="center")


def labels_apart(places: Sequence[np.ndarray], size: np.ndarray) -> list[np.ndarray]:
    """Where labels of one size stand so that none covers another: each at its place, or as near as there is space."""
    turns = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    around = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    rings = np.concatenate([np.zeros((1, 2)), *(ring * around for ring in range(1, 3 + 2 * len(places)))]) * size
    labels: list[np.ndarray] = []
    for place in places:
        tried = place + rings
        taken = np.reshape(labels, (-1, 2))
        free = (np.abs(tried[:, None] - taken) >= size).any(axis=2).all(axis=1)
        labels.append(tried[free.argmax()])
    return labels


def _visible_places(corners: np.ndarray, faces: np.ndarray) -> dict[int, np.ndarray]:
    """For each face that is seen the middle of a triangle that nothing covers, best near the middle of the face.

    Args:
        corners: of the triangles that face the eye: to the right, up, and towards it [mm], shape (count, 3, 3).
        faces: face of each, shape (count,).
    """
    centres, tried = corners.mean(axis=1), list[int]()
    for face in np.unique(faces):
        its = np.flatnonzero(faces == face)
        away = np.linalg.norm(centres[its, :2] - centres[its, :2].mean(axis=0), axis=1)
        for order in (away, -centres[its, 2]):
            tried += its[np.argsort(order, kind="stable")[:TRIED]].tolist()
    crossings = ray_crossings(centres[tried], np.array([0.0, 0.0, 1.0]), corners)
    covered = crossings.ray[crossings.distance > 1e-6 * np.abs(corners).max()]
    places: dict[int, np.ndarray] = {}
    for number in np.setdiff1d(np.arange(len(tried)), covered):
        places.setdefault(int(faces[tried[number]]), centres[tried[number], :2])
    return places
