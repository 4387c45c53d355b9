"""`mesh-report.png`: the mesh cut open, and histograms of the shapes of its elements."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.base import atomic_file, require
from taichisoft.errors import MeshError
from taichisoft.mesh import SectionPlane, VolumeMesh, cut_tetrahedra, split_triangles
from taichisoft_meshing.closed_shells import area_vectors
from taichisoft_meshing.mesh_quality import MeshQuality, QualityLimits
from taichisoft_meshing.wall_quality import FACES, SurfaceQuality, neighbours

EDGE_ON = 1e-6
"""Cosine of the angle below which a face is seen as a line, and left out [-]."""
CUT, OUTER, CAVITY = range(3)
COLOURS = {OUTER: ("outer skin", "#c9c5bd"), CAVITY: ("wall of a cavity", "#7fb3d9")}
PARTS = ("#d9a441", "#7a9e5f", "#b0699a", "#5f8f95", "#c06b4c")
"""Colours of the element groups."""
SHAPES = "YlOrRd_r"
"""Colours of the radius ratio: flat elements are dark, for every kind of eye."""


@dataclass(frozen=True)
class CutMesh:
    """The half of a mesh behind a cut: its faces that an eye straight before the cut sees, farthest first.

    Attributes:
        corners: corners of each face: to the right, up, and towards the eye [mm], shape (face_count, 3, 3).
        element: element of each face, shape (face_count,).
        side: CUT, OUTER or CAVITY, shape (face_count,).
        facing: cosine of the angle at which each face is seen [-], shape (face_count,).
        plane: the plane of the section in words.
        axes: directions to the right and up [-], shape (2, 3).
    """

    corners: np.ndarray
    element: np.ndarray
    side: np.ndarray
    facing: np.ndarray
    plane: str
    axes: np.ndarray


def cut_open(mesh: VolumeMesh, surfaces: Sequence[SurfaceQuality], section: SectionPlane | None = None) -> CutMesh:
    """Cut a mesh along a plane, or along its two longest dimensions through the middle of the cavities if any."""
    axes = np.argsort(-np.ptp(mesh.nodes, axis=0), kind="stable")
    walls = np.unique(np.concatenate([np.empty(0, dtype=int), *(s.triangles.ravel() for s in surfaces if s.of_cavity)]))
    if section is None:
        inside = mesh.nodes[walls if len(walls) else slice(None), axes[2]]
        normal = tuple(np.eye(3)[axes[2]].tolist())
        section = SectionPlane(normal, float(inside.min() + inside.max()) / 2, True)
    right, up, towards = _view(section, np.eye(3)[axes])
    height = np.sign(towards @ section.normal) * section.height(mesh.nodes)
    plane = f"{_in_words(np.array(section.normal))} = {round(section.offset, 6) + 0.0:.4g} mm"
    if not height.min() < 0.0 < height.max():
        lower, upper = (np.round(end(mesh.nodes, axis=0), 3).tolist() for end in (np.min, np.max))
        raise MeshError(f"section {plane}: does not cut the mesh, which spans {lower} to {upper} mm")
    nodes = np.column_stack([mesh.nodes @ right, mesh.nodes @ up, height])
    elements = mesh.elements[:, :4]
    element, face = np.nonzero(neighbours(elements) < 0)
    faces = elements[element[:, None], FACES[face]]
    side = np.where(np.isin(faces, walls).all(axis=1), CAVITY, OUTER)
    labels = np.broadcast_to(np.stack([element, side], axis=1)[:, None], (len(faces), 3, 2))
    skin, _, _ = split_triangles(np.concatenate([nodes[faces], labels], axis=2), height[faces])
    cut, of_cut = cut_tetrahedra(nodes[elements], height[elements], (0.0, 0.0, 1.0))
    element = np.concatenate([np.rint(skin[:, 0, 3]).astype(int), of_cut])
    side = np.concatenate([np.rint(skin[:, 0, 4]).astype(int), np.full(len(cut), CUT)])
    corners = np.concatenate([skin[..., :3], cut])
    normals = area_vectors(corners)
    facing = normals[:, 2] / np.maximum(np.linalg.norm(normals, axis=1), 1e-30)
    # Nothing that is kept stands before the section.
    order = np.lexsort((corners[:, :, 2].mean(axis=1), side == CUT))
    seen = order[facing[order] > EDGE_ON]
    return CutMesh(corners[seen], element[seen], side[seen], facing[seen], plane, np.array([right, up]))


def _view(section: SectionPlane, longest: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Directions to the right, along the longest axis in the plane, up, and towards the eye, a right-handed system.

    Both axes of the picture point along axes of the mesh where the plane may turn its normal, else the one up does.
    """
    normal = np.array(section.normal)
    across = [axis - (axis @ normal) * normal for axis in longest]
    first, second = [axis / np.linalg.norm(axis) for axis in across if np.linalg.norm(axis) > 0.1][:2]
    second = second - (second @ first) * first
    second /= np.linalg.norm(second)
    towards = np.cross(first, second)
    if towards @ normal < 0 and not section.is_turned:
        return -first, second, -towards
    return first, second, towards


def _in_words(direction: np.ndarray) -> str:
    """A direction as "x", "-y" or "0.6 x + 0.8 z"."""
    terms = []
    for share, name in zip(direction.tolist(), "xyz", strict=True):
        if abs(share) > 1e-9:
            amount = "" if abs(abs(share) - 1.0) < 1e-9 else f"{abs(share):.3g} "
            terms.append(f"{'-' if share < 0 else '+'} {amount}{name}")
    return " ".join(terms).removeprefix("+ ").replace("- ", "-", int(terms[0][0] == "-"))


def draw_report(
    mesh: VolumeMesh,
    quality: MeshQuality,
    limits: QualityLimits,
    title: str,
    path: Path,
    section: SectionPlane | None = None,
) -> None:
    """Draw a mesh cut open, by its shapes and by its parts, and the histograms of radius ratios and dihedral angles."""
    require("a report's picture", "matplotlib")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 8.0), dpi=110, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    upper, lower = figure.subfigures(2, 1, height_ratios=(1.6, 1.0), squeeze=False)[:, 0]
    _draw_mesh(upper, mesh, quality, title, section)
    ratios, angles = lower.subplots(1, 2)
    _draw_histogram(ratios, quality.radius_ratios, 1.0, "radius ratio", (limits.radius_ratio,))
    bounds = (limits.smallest_dihedral_angle, limits.largest_dihedral_angle)
    _draw_histogram(angles, quality.dihedral_angles.ravel(), 180.0, "dihedral angle [degrees]", bounds)
    with atomic_file(path, MeshError) as partial:
        figure.savefig(partial, format="png", metadata={"Software": None})  # equal meshes give equal files


def _draw_mesh(figure: Any, mesh: VolumeMesh, quality: MeshQuality, title: str, section: SectionPlane | None) -> None:
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgba
    from matplotlib.patches import Patch

    cut = cut_open(mesh, quality.surfaces, section)
    shapes = ScalarMappable(cmap=colormaps[SHAPES])
    shapes.set_clim(0.0, 1.0)
    by_shape = shapes.to_rgba(quality.radius_ratios[cut.element])
    for side, (_, colour) in COLOURS.items():
        by_shape[cut.side == side] = to_rgba(colour)
    handles = [Patch(facecolor=colour, label=label) for side, (label, colour) in COLOURS.items() if side in cut.side]
    panels = [by_shape]
    parts = {name: group for name, group in mesh.element_groups.items() if 0 < len(group) < len(mesh.elements)}
    if parts:
        by_part = by_shape.copy()
        by_part[cut.side != CAVITY] = to_rgba(COLOURS[OUTER][1])
        for number, (name, group) in enumerate(parts.items()):
            colour = PARTS[number % len(PARTS)]
            by_part[np.isin(cut.element, group) & (cut.side != CAVITY)] = to_rgba(colour)
            handles.append(Patch(facecolor=colour, label=plain_label(name)))
        panels.append(by_part)
    wide = np.ptp(cut.corners[..., 0]) > 1.5 * np.ptp(cut.corners[..., 1])
    shape = (len(panels), 1) if wide else (1, len(panels))
    plots = figure.subplots(*shape, squeeze=False, sharex=True, sharey=True).ravel()
    for axes, colours in zip(plots, panels, strict=True):
        colours[:, :3] *= (0.7 + 0.3 * cut.facing)[:, None]
        polygons = list(cut.corners[:, :, :2])
        axes.add_collection(PolyCollection(polygons, facecolors=colours, edgecolors="#303030", linewidths=0.25))
        axes.autoscale_view()
        axes.set_aspect("equal")
        for axis, direction in zip((axes.xaxis, axes.yaxis), cut.axes, strict=True):
            sign = -1.0 if direction.min() < -1 + 1e-9 else 1.0
            axis.set_major_formatter(lambda value, _, sign=sign: f"{sign * value + 0.0:g}")
            axis.set_label_text(f"{_in_words(sign * direction)} [mm]")
        axes.spines[["top", "right"]].set_visible(False)
    across = quality.elements_across_walls
    walls = "" if across is None else f", walls at least {across} of them thick"
    size = " x ".join(f"{length:.4g}" for length in np.ptp(mesh.nodes, axis=0))
    counts = f"{size} mm, {len(mesh.nodes)} nodes, {len(mesh.elements)} tetrahedra"
    figure.suptitle(f"{plain_label(textwrap.fill(title, 90))}\ncut at {cut.plane}; {counts}{walls}", fontsize=12)
    figure.colorbar(shapes, ax=plots.tolist(), label="radius ratio on the cut", shrink=0.8, pad=0.01, panchor=False)
    figure.legend(handles=handles, loc="outside lower left", frameon=False, ncols=min(len(handles), 5))


def plain_label(text: str) -> str:
    """Text between two dollars of which matplotlib reads no formula."""
    return text.replace("$", r"\$")


def _draw_histogram(axes: Any, values: np.ndarray, highest: float, label: str, limits: Sequence[float]) -> None:
    axes.hist(np.clip(values, 0.0, highest), bins=50, range=(0.0, highest))
    for limit in limits:
        axes.axvline(limit, color="#c0392b", linestyle="--")
    axes.set(xlabel=f"{label}   (dashed: limit)", ylabel="count", xlim=(0.0, highest))
    axes.set_title(
        f"smallest {values.min():.3g}, median {np.median(values):.3g}, largest {values.max():.3g}", fontsize=10
    )
