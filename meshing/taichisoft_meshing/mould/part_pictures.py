"""A picture of each part of a mould, from above and from below, with the places that the check found."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from taichisoft.atomic_file import atomic_file
from taichisoft.errors import MeshError
from taichisoft.optional_packages import require
from taichisoft.worker import WorkerLost, call_apart
from taichisoft_meshing.mould.mould_check import CheckedPart

SIZE = (900, 640)
"""Width and height of each of the two views [pixels]."""
PRINTED, SILICONE, HELD, THIN = (0.55, 0.66, 0.76), (0.86, 0.80, 0.68), (0.80, 0.10, 0.10), (0.95, 0.60, 0.05)
"""Colours of what is printed and of silicone, of what an undercut holds, and of walls too thin to print."""
INK, LETTERS = (0.1, 0.12, 0.14), 22.0
"""Colour [-] and height [pixels] of the letters."""
TIME_LIMIT = 300.0
"""Longest time that the pictures may take [s]."""


def draw_parts(parts: Sequence[CheckedPart]) -> list[Path]:
    """Draw each part to a PNG beside its STL file.

    Raises:
        PackageMissing: Open3D is not installed.
        MeshError: nothing can be drawn here, or a file cannot be written.
    """
    require("pictures of a mould", "open3d")
    from PIL import Image

    try:
        images = call_apart(
            "taichisoft_meshing.mould.part_pictures:draw_views",
            [(part.corners, _colours(part)) for part in parts],
            time_limit=TIME_LIMIT,
        )
    except (WorkerLost, OSError, RuntimeError) as error:
        raise MeshError(f"the parts cannot be drawn: {error}; `taichisoft doctor` says what is missing") from error
    from taichisoft_outputs.drawing.overlay import paint_caption

    files = [part.file.with_suffix(".png") for part in parts]
    for image, file, part in zip(images, files, parts, strict=True):
        picture = Image.fromarray(image)
        size = " x ".join(f"{length:.1f}" for length in np.ptp(part.corners, axis=(0, 1)))
        paint_caption(picture, [file.stem, f"{size} mm", "from above and from below"], INK, LETTERS)
        with atomic_file(file, MeshError) as partial:
            picture.save(partial, format="png")
    return files


def draw_views(parts: Sequence[tuple[np.ndarray, np.ndarray]]) -> list[np.ndarray]:
    """What the drawing process does: two views of each part, beside each other, dtype uint8.

    Args:
        parts: corners [mm], shape (count, 3, 3), and colours of the triangles [-], (count, 3), of each part.
    """
    from taichisoft_outputs.drawing.antialiasing import antialias
    from taichisoft_outputs.drawing.camera import fit_camera, scene_axes, seen_from_front
    from taichisoft_outputs.drawing.shading import KEY_LIGHT, shade
    from taichisoft_outputs.drawing.stage import EMPTY, Stage
    from taichisoft_outputs.drawing.surface_painter import draw_lines

    stage = Stage(SIZE)  # a process can have only one
    images = []
    for corners, colours in parts:
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
        views = []
        for up in (np.array([0.0, 1.0, 0.0]), np.array([0.0, -1.0, 0.0])):
            key = np.array(KEY_LIGHT) @ scene_axes(up)
            camera = fit_camera(corners.reshape(-1, 3), up, "iso", SIZE[0] / SIZE[1])
            front = seen_from_front(camera, corners)
            points, triangles = corners[front].reshape(-1, 3), np.arange(3 * front.sum()).reshape(-1, 3)
            shown = shade(colours[front], normals[front], key / np.linalg.norm(key), up)
            for name, of_triangle in (("part", shown), ("normals", 0.5 + 0.5 * normals[front])):
                stage.put(name, points, triangles, np.repeat(of_triangle, 3, axis=0))
            image = stage.image(camera, ["part"])
            draw_lines(image, stage.image(camera, ["normals"]))
            image[(image == EMPTY).all(axis=2)] = 255
            views.append(antialias(image))
        images.append(np.concatenate(views, axis=1))
    return images


def _colours(part: CheckedPart) -> np.ndarray:
    colours = np.tile(PRINTED if part.printed else SILICONE, (len(part.corners), 1))
    colours[part.thin] = THIN
    for undercut in part.undercuts:
        colours[undercut.triangles] = HELD
    return colours
