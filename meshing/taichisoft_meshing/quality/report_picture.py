"""`mesh-report.png`: the mesh cut open, and histograms of the shapes of its elements."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.atomic_file import atomic_file
from taichisoft.errors import MeshError
from taichisoft.meshes import VolumeMesh, cut_tetrahedra, split_triangles
from taichisoft.optional_packages import require
from taichisoft_meshing.quality.mesh_quality import MeshQuality
from taichisoft_meshing.quality.mesh_surfaces import SurfaceQuality
from taichisoft_meshing.quality.quality_limits import QualityLimits
from taichisoft_meshing.quality.tetrahedra import FACES, neighbours

TILT = np.radians(25.0)
"""Angle of the eye above the line at a right angle to the cut [rad]."""
CUT, OUTER, CAVITY = range(3)
COLOURS = {OUTER: ("outer skin", "#c9c5bd"), CAVITY: ("wall of a cavity", "#7fb3d9")}
SHAPES = "YlOrRd_r"
"""Colours of the radius ratio: flat elements are dark, for every kind of eye."""


@dataclass(frozen=True)
class CutMesh:
    """The half of a mesh behind a cut: its faces that an eye before the cut sees, farthest first.

    Attributes:
        corners: corners of each face: to the right, up, and towards the eye [mm], shape (face_count, 3, 3).
        element: element of each face, shape (face_count,).
        side: CUT, OUTER or CAVITY, shape (face_count,).
        facing: cosine of the angle at which each face is seen [-], shape (face_count,).
        plane: the plane of the section in words.
    """

    corners: np.ndarray
    element: np.ndarray
    side: np.ndarray
    facing: np.ndarray
    plane: str


def cut_open(mesh: VolumeMesh, surfaces: Sequence[SurfaceQuality]) -> CutMesh:
    """Cut a mesh along its two longest dimensions, through the middle of the cavities if there are any."""
    axes = np.argsort(-np.ptp(mesh.nodes, axis=0), kind="stable")
    right, up, towards = (np.eye(3)[axis] for axis in axes)
    towards *= np.linalg.det([right, up, towards])
    nodes, elements = mesh.nodes @ np.column_stack([right, up, towards]), mesh.elements[:, :4]
    walls = np.unique(np.concatenate([np.empty(0, dtype=int), *(s.triangles.ravel() for s in surfaces if s.of_cavity)]))
    inside = nodes[walls, 2] if len(walls) else nodes[:, 2]
    middle = (inside.min() + inside.max()) / 2
    element, face = np.nonzero(neighbours(elements) < 0)
    faces = elements[element[:, None], FACES[face]]
    side = np.where(np.isin(faces, walls).all(axis=1), CAVITY, OUTER)
    labels = np.broadcast_to(np.stack([element, side], axis=1)[:, None], (len(faces), 3, 2))
    skin, _, _ = split_triangles(np.concatenate([nodes[faces], labels], axis=2), nodes[faces, 2] - middle)
    section, of_section = cut_tetrahedra(nodes[elements], nodes[elements, 2] - middle, (0.0, 0.0, 1.0))
    element = np.concatenate([np.rint(skin[:, 0, 3]).astype(int), of_section])
    side = np.concatenate([np.rint(skin[:, 0, 4]).astype(int), np.full(len(section), CUT)])
    turn = np.array([[1, 0, 0], [0, np.cos(TILT), -np.sin(TILT)], [0, np.sin(TILT), np.cos(TILT)]])
    corners = np.concatenate([skin[..., :3], section]) @ turn.T
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = normals[:, 2] / np.maximum(np.linalg.norm(normals, axis=1), 1e-30)
    # Nothing that is kept stands before the section.
    order = np.lexsort((corners[:, :, 2].mean(axis=1), side == CUT))
    seen = order[facing[order] > 0]
    plane = f"{'xyz'[axes[2]]} = {round(towards.sum() * middle, 6) + 0.0:.4g} mm"
    return CutMesh(corners[seen], element[seen], side[seen], facing[seen], plane)


def draw_report(mesh: VolumeMesh, quality: MeshQuality, limits: QualityLimits, title: str, path: Path) -> None:
    """Draw a mesh and the histograms of its radius ratios and dihedral angles.

    Raises:
        MeshError: the file cannot be written.
    """
    require("a report's picture", "matplotlib")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 8.0), dpi=110, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    upper, lower = figure.subfigures(2, 1, height_ratios=(1.6, 1.0), squeeze=False)[:, 0]
    _draw_mesh(upper, mesh, quality, title)
    ratios, angles = lower.subplots(1, 2)
    _draw_histogram(ratios, quality.radius_ratios, 1.0, "radius ratio", (limits.radius_ratio,))
    bounds = (limits.smallest_dihedral_angle, limits.largest_dihedral_angle)
    _draw_histogram(angles, quality.dihedral_angles.ravel(), 180.0, "dihedral angle [degrees]", bounds)
    with atomic_file(path, MeshError) as partial:
        figure.savefig(partial, format="png", metadata={"Software": None})  # equal meshes give equal files


def _draw_mesh(figure: Any, mesh: VolumeMesh, quality: MeshQuality, title: str) -> None:
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgba
    from matplotlib.patches import Patch

    cut = cut_open(mesh, quality.surfaces)
    shapes = ScalarMappable(cmap=colormaps[SHAPES])
    shapes.set_clim(0.0, 1.0)
    colours = shapes.to_rgba(quality.radius_ratios[cut.element])
    for side, (_, colour) in COLOURS.items():
        colours[cut.side == side] = to_rgba(colour)
    colours[:, :3] *= (0.7 + 0.3 * cut.facing)[:, None]
    axes = figure.subplots()
    corners = list(cut.corners[:, :, :2])
    axes.add_collection(PolyCollection(corners, facecolors=colours, edgecolors="#303030", linewidths=0.25))
    axes.autoscale_view()
    axes.set(aspect="equal", xlabel="mm", frame_on=False, yticks=[])
    across = quality.elements_across_walls
    walls = "" if across is None else f", walls at least {across} of them thick"
    name = textwrap.fill(title, 90).replace("$", r"\$")  # between two of which matplotlib reads formulas
    counts = f"{len(mesh.nodes)} nodes, {len(mesh.elements)} tetrahedra"
    figure.suptitle(f"{name}\ncut at {cut.plane}; {counts}{walls}", fontsize=12)
    figure.colorbar(shapes, ax=axes, label="radius ratio on the cut", shrink=0.8, pad=0.01)
    handles = [Patch(facecolor=colour, label=label) for side, (label, colour) in COLOURS.items() if side in cut.side]
    axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.0, -0.05), frameon=False, ncols=2)


def _draw_histogram(axes: Any, values: np.ndarray, highest: float, label: str, limits: Sequence[float]) -> None:
    axes.hist(np.clip(values, 0.0, highest), bins=50, range=(0.0, highest))
    for limit in limits:
        axes.axvline(limit, color="#c0392b", linestyle="--")
    axes.set(xlabel=f"{label}   (dashed: limit)", ylabel="count", xlim=(0.0, highest))
    axes.set_title(
        f"smallest {values.min():.3g}, median {np.median(values):.3g}, largest {values.max():.3g}", fontsize=10
    )
