"""Stress over stretch: what was measured, and what laws make of it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.optional_packages import require
from taichisoft.scenes import Material
from taichisoft_outputs.materials.nominal_stress import nominal_stress
from taichisoft_outputs.materials.tension_test import MaterialError, TensionTest

FORMATS = (".png", ".svg")


def draw_materials(
    materials: Mapping[str, Material], tests: Mapping[str, TensionTest], path: Path, columns: int = 4
) -> None:
    """A panel for each material: points of its test where there is one, its law up to its highest stretch.

    Raises:
        MaterialError: the picture's format is unknown.
    """
    if path.suffix.lower() not in FORMATS:
        raise MaterialError(f"{path}: a picture must end in {' or '.join(FORMATS)}")
    require("a plot of materials", "matplotlib")
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib.figure import Figure

    columns = min(columns, len(materials))
    rows = -(-len(materials) // columns)
    figure = Figure(figsize=(3.2 * columns, 2.4 * rows), layout="constrained")
    panels: Sequence[Any] = list(figure.subplots(rows, columns, squeeze=False).flat)
    for panel, (name, material) in zip(panels, materials.items(), strict=False):
        _draw(panel, material, tests.get(name))
        panel.set_title(material.name, fontsize=9)
    for panel in panels[len(materials) :]:
        panel.set_axis_off()
    figure.supxlabel("stretch [-]", fontsize=9)
    figure.supylabel("force over area at rest [kPa]", fontsize=9)
    with matplotlib.rc_context({"svg.hashsalt": "taichisoft"}):  # the same file every time
        figure.savefig(path, dpi=120, metadata={"Date": None} if path.suffix.lower() == ".svg" else None)


def _draw(panel: Any, material: Material, test: TensionTest | None) -> None:
    if test is not None:
        shown = test.stretch <= 1.15 * material.highest_stretch
        panel.plot(test.stretch[shown], test.stress[shown], ".", color="0.6", markersize=3, label="measured")
    stretch = np.linspace(1.0, material.highest_stretch, 100)
    stress = nominal_stress(material.law, material.coefficients, stretch)
    panel.plot(stretch, stress, color="C0", linewidth=1.2, label=material.law)
    panel.legend(fontsize=7, frameon=False)
    panel.tick_params(labelsize=7)
