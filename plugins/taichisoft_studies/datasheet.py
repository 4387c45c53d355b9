"""The characteristics of a finger for people: a table, curves, and a page."""

import csv
from pathlib import Path

import numpy as np

from taichisoft import Scene
from taichisoft.atomic_file import atomic_file
from taichisoft.scenes import scene_to_toml
from taichisoft_outputs.html_template import render, svg_element
from taichisoft_outputs.plots.figure import Panel, PlotCurve, draw_figure, figure_bytes
from taichisoft_studies.characteristics import Characteristics
from taichisoft_studies.errors import StudyError

TEMPLATE = Path(__file__).with_name("characteristics.html")
TABLE, PICTURE, PAGE = "characteristics.csv", "characteristics.png", "datasheet.html"
PRESSURE = "pressure [kPa]"
SECOND = ", second mesh"
"""Ends the names of what was found on the other mesh."""


def write_datasheet(
    folder: Path, scene: Scene, first: Characteristics, second: Characteristics | None, change: str
) -> list[Path]:
    """Write the table, the picture and the page of a finger's characteristics, and return their paths.

    Args:
        folder: where they are written.
        scene: the scene.
        first: what was found.
        second: what was found on another mesh, whose difference tells the error; None without one.
        change: how the other mesh differs; "" without one.

    Raises:
        StudyError: a file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    columns = _columns(first)
    if second is not None:
        columns |= {f"{name}{SECOND}": values for name, values in _columns(second).items() if name != PRESSURE}
    rows = [[_text(value) for value in row] for row in zip(*columns.values(), strict=True)]
    with atomic_file(folder / TABLE, StudyError) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([list(columns), *rows])
    figure = draw_figure(_panels(first, second), ["", SECOND])
    with atomic_file(folder / PICTURE, StudyError) as partial:
        partial.write_bytes(figure_bytes(figure, "png"))
    last = first.pressures[-1]
    page = render(
        TEMPLATE,
        title=f"{scene.title or 'finger'}: characteristics",
        status=f"at rest under pressures from 0 to {last:g} kPa, free and held up by blocks",
        headlines=[
            (f"bending at {last:g} kPa", f"{first.bending[-1]:.3g} degrees"),
            (f"force of the straight finger at {last:g} kPa", f"{first.forces[0, -1]:.3g} mN"),
            (f"stiffness of the tip at {last:g} kPa", f"{first.stiffness[-1]:.3g} mN/mm"),
            ("air to be let in", f"{(first.volumes[-1] - first.volumes[0]) / 1e3:.3g} cm³"),
        ],
        plots=svg_element(figure_bytes(figure, "svg").decode()),
        columns=list(columns),
        rows=rows,
        trust=trust_line(first, second, change),
        scene=scene_to_toml(scene),
    )
    with atomic_file(folder / PAGE, StudyError) as partial:
        partial.write_text(page, encoding="utf-8")
    return [folder / name for name in (TABLE, PICTURE, PAGE)]


def trust_line(first: Characteristics, second: Characteristics | None, change: str) -> str:
    """How much another mesh changes, which is about the error of the first one where the other is finer."""
    if second is None:
        return "There is no second mesh, so nothing is known of the error of this one."
    bend = _largest_difference(first.bending, second.bending)
    force = _largest_difference(first.forces, second.forces)
    return (
        f"With {change}, bending differs by up to {100 * bend:.1f} % of its largest value, and forces by up to "
        f"{100 * force:.1f} %."
    )


def _largest_difference(first: np.ndarray, second: np.ndarray) -> float:
    return float(np.nanmax(np.abs(second - first)) / np.nanmax(np.abs(second)))


def _columns(found: Characteristics) -> dict[str, np.ndarray]:
    held = {
        f"force held at {found.pressures[number]:g} kPa [mN]": forces
        for number, forces in zip(found.blocked, found.forces, strict=True)
    }
    free = {"bending [degrees]": found.bending, "way of the tip [mm]": found.way, "volume [cm³]": found.volumes / 1e3}
    return {PRESSURE: found.pressures, **free, **held, "stiffness [mN/mm]": found.stiffness}


def _text(value: float) -> str:
    return "" if np.isnan(value) else f"{round(float(value), 6) + 0.0:.5g}"


def _panels(first: Characteristics, second: Characteristics | None) -> list[Panel]:
    meshes = [("", first), *([(SECOND, second)] if second is not None else [])]

    def panel(y_axis: str, curves: list[tuple[str, np.ndarray, np.ndarray]], x_axis: str = PRESSURE) -> Panel:
        made = [
            PlotCurve(label, SECOND if label.endswith(SECOND) else "", x, y, np.arange(len(x), dtype=float))
            for label, x, y in curves
        ]
        return Panel(x_axis, y_axis, made)

    return [
        panel("bending angle [degrees]", [(f"free{of}", one.pressures, one.bending) for of, one in meshes]),
        panel(
            "force on the block [mN]",
            [
                (f"held at {one.bending[number]:.3g} degrees, {one.pressures[number]:g} kPa{of}", one.pressures, forces)
                for of, one in meshes
                for number, forces in zip(one.blocked, one.forces, strict=True)
            ],
        ),
        panel("stiffness of the tip [mN/mm]", [(f"secant{of}", one.pressures, one.stiffness) for of, one in meshes]),
        panel(
            f"force at {first.pressures[-1]:g} kPa [mN]",
            [
                (
                    f"over its bend{of}",
                    np.append(one.bending[one.blocked], one.bending[-1]),
                    np.append(one.forces[:, -1], 0.0),
                )
                for of, one in meshes
            ],
            "bend at which the tip is held [degrees]",
        ),
    ]
