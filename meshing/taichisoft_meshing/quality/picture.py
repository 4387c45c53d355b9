"""`mesh-report.png`: the mesh cut open, and how its elements are shaped."""

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.atomic_file import atomic_file
from taichisoft.errors import MeshError
from taichisoft.meshes.volume_mesh import VolumeMesh
from taichisoft_meshing.quality.limits import QualityLimits
from taichisoft_meshing.quality.mesh_quality import MeshQuality
from taichisoft_meshing.quality.open_view import OpenView, Side, open_view

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIDE_COLOURS = {Side.OUTER: "#c9c5bd", Side.CAVITY: "#7fb3d9"}
SHAPES = "YlOrRd_r"
"""Colours of the radius ratio: flat elements are dark, for every kind of eye."""
BARS = "#6f8fa8"
LIMIT = "#c0392b"


def draw_report(mesh: VolumeMesh, quality: MeshQuality, limits: QualityLimits, title: str, path: Path) -> None:
    """Draw a mesh of positive elements and the histograms of its radius ratios and dihedral angles.

    Raises:
        MeshError: the file cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 8.0), dpi=110, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    upper, lower = figure.subfigures(2, 1, height_ratios=(1.6, 1.0), squeeze=False)[:, 0]
    _draw_mesh(upper, mesh, quality, title)
    ratios, angles = lower.subplots(1, 2)
    _draw_histogram(ratios, quality.radius_ratios, (0.0, 1.0), "radius ratio", "tetrahedra", (limits.radius_ratio,))
    bounds = (limits.smallest_dihedral_angle, limits.largest_dihedral_angle)
    _draw_histogram(angles, quality.dihedral_angles.ravel(), (0.0, 180.0), "dihedral angle [degrees]", "edges", bounds)
    with atomic_file(path, MeshError) as partial:
        figure.savefig(partial, format="png", metadata={"Software": None})  # equal meshes give equal files


def _draw_mesh(figure: Any, mesh: VolumeMesh, quality: MeshQuality, title: str) -> None:
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import Normalize
    from matplotlib.patches import Patch

    axes = figure.subplots()
    view = open_view(mesh, quality.surfaces)
    shapes = ScalarMappable(Normalize(0.0, 1.0), colormaps[SHAPES])
    colours = _face_colours(view, shapes.to_rgba(quality.radius_ratios[view.element]))
    axes.add_collection(PolyCollection(list(view.corners), facecolors=colours, edgecolors="#303030", linewidths=0.25))
    low, high = view.corners.min(axis=(0, 1)), view.corners.max(axis=(0, 1))
    margin = 0.03 * (high - low).max()
    axes.set(xlim=(low[0] - margin, high[0] + margin), ylim=(low[1] - 3 * margin, high[1] + margin), aspect="equal")
    axes.set_axis_off()
    across = quality.elements_across_walls
    walls = "" if across is None else f", walls at least {across} of them thick"
    figures = f"cut open; {len(mesh.nodes)} nodes, {len(mesh.elements)} tetrahedra{walls}"
    name = textwrap.fill(title, 90).replace("$", r"\$")  # between two of which matplotlib reads formulas
    figure.suptitle(f"{name}\n{figures}", fontsize=12)
    _draw_scale(axes, low, high, margin)
    figure.colorbar(shapes, ax=axes, label="radius ratio on the cut", shrink=0.8, pad=0.01)
    names = {Side.OUTER: "outer skin", Side.CAVITY: "wall of a cavity"}
    patches = [
        Patch(facecolor=SIDE_COLOURS[side], label=name) for side, name in names.items() if (view.side == side).any()
    ]
    axes.legend(handles=patches, loc="upper right", bbox_to_anchor=(1.0, 0.09), frameon=False, ncols=2)


def _face_colours(view: OpenView, on_cut: np.ndarray) -> np.ndarray:
    """Colours of faces, shaded by the angle at which each is seen, shape (face_count, 4)."""
    from matplotlib.colors import to_rgba

    colours = on_cut.copy()
    for side, colour in SIDE_COLOURS.items():
        colours[view.side == side] = to_rgba(colour)
    colours[:, :3] *= (0.7 + 0.3 * view.facing)[:, None]
    return colours


def _draw_scale(axes: "Axes", low: np.ndarray, high: np.ndarray, margin: float) -> None:
    """Draw a line of a round length under the left end of the mesh."""
    tenth = 10.0 ** np.floor(np.log10((high - low)[0] / 2))
    length = max(step * tenth for step in (1.0, 2.0, 5.0) if step * tenth <= (high - low)[0] / 4 or step == 1.0)
    axes.plot([low[0], low[0] + length], [low[1] - margin] * 2, color="black", linewidth=2)
    axes.text(low[0] + length + margin / 2, low[1] - margin, f"{length:g} mm", va="center")


def _draw_histogram(
    axes: "Axes", values: np.ndarray, span: tuple[float, float], label: str, what: str, limits: tuple[float, ...]
) -> None:
    axes.hist(np.clip(values, *span), bins=50, range=span, color=BARS)
    for limit in limits:
        axes.axvline(limit, color=LIMIT, linestyle="--", linewidth=1.2)
    axes.set(xlabel=f"{label}   (dashed: limit)", ylabel=what, xlim=span)
    axes.set_title(
        f"smallest {values.min():.3g}, median {np.median(values):.3g}, largest {values.max():.3g}", fontsize=10
    )
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
