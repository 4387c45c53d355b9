"""The picture of a body from CAD with the numbers of its faces, seen from two opposite corners."""

from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.atomic_file import atomic_file
from taichisoft.errors import MeshError
from taichisoft.optional_packages import require
from taichisoft_meshing.bodies.cad_body import CadBody

EYES = ((1.0, -1.4, 0.9), (-1.0, 1.4, -0.9))
"""Directions from the body to the two eyes: every face of a block is seen by one of them."""
TRIED = 6  # triangles of a face, those near its middle and those near the eye, that are tried as its number's place


def draw_faces(body: CadBody, path: Path) -> None:
    """Draw a body with its faces in many colours, each with its number where it is seen.

    Raises:
        MeshError: the file cannot be written.
    """
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
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
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
    for face in np.unique(body.face_of[seen]).tolist():
        place = _visible_place(corners, seen, np.flatnonzero(body.face_of[seen] == face))
        if place is not None:
            axes.text(*place, str(face), ha="center", va="center", fontsize=9, bbox=box)
    span = np.ptp(corners[seen, :, :2].reshape(-1, 2), axis=0).max()
    origin = corners[seen, :, :2].reshape(-1, 2).min(axis=0) - 0.08 * span
    for name, axis in zip("xyz", view[:, :2], strict=True):
        ends = np.array([origin, origin + 0.08 * span * axis]).T
        axes.plot(*ends, color="#404040", linewidth=1.5)
        axes.text(*(origin + 0.1 * span * axis), name, color="#404040", ha="center", va="center")


def _visible_place(corners: np.ndarray, seen: np.ndarray, its: np.ndarray) -> np.ndarray | None:
    """The centre of a triangle that nothing covers, best near the middle of its face; None where there is none.

    Args:
        corners: of all triangles: to the right, up, and towards the eye [mm], shape (triangle_count, 3, 3).
        seen: triangles that face the eye.
        its: which of these are of the face.
    """
    centres = corners[seen[its]].mean(axis=1)
    middle = centres[:, :2].mean(axis=0)
    nearest = np.argsort(np.linalg.norm(centres[:, :2] - middle, axis=1), kind="stable")
    a, b, c = np.moveaxis(corners[seen], 1, 0)
    highest = np.argsort(-centres[:, 2], kind="stable")
    for number in (*nearest[:TRIED], *highest[:TRIED]):
        p = centres[number]
        shares = np.column_stack([_doubled(p, b, c), _doubled(a, p, c), _doubled(a, b, p)])
        shares = shares / _doubled(a, b, c)[:, None]
        depth = (shares * corners[seen][:, :, 2]).sum(axis=1)
        covered = (shares > -1e-9).all(axis=1) & (depth > p[2] + 1e-6 * np.abs(corners).max())
        if not covered.any():
            place: np.ndarray = p[:2]
            return place
    return None


def _doubled(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Twice the signed areas of triangles in the plane of the picture [mm^2]."""
    u, v = b - a, c - a
    area: np.ndarray = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
    return area
