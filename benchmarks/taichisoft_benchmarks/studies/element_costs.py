"""Bend of the tutorial's finger and time of a step, by kind of element."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from taichisoft_benchmarks.growth_plots import svg_axes
from taichisoft_benchmarks.studies.finger_at_rest import bend

ELEMENTS = ("linear", "smoothed", "quadratic")
MESHES: tuple[Any, ...] = ("tutorial-coarse", "tutorial-medium", {"file": "tutorial.toml", "preset": "medium"})
"""Meshes of linear and smoothed elements; quadratic ones, which have six times the nodes, leave out the last."""
POISSON_RATIOS = (0.3, 0.49)
LIMITS = {0.3: 72.9}
"""Where quadratic elements lead under refinement [mm] (docs/notes/experiments.md), where it is known."""
WARM_UP, STEPS = 5, 15


@dataclass(frozen=True)
class Cost:
    """The finger on one mesh.

    Attributes:
        element: kind of its elements.
        poisson_ratio: [-].
        nodes: number of nodes, with the middle nodes of quadratic elements.
        bend: largest displacement at 30 kPa, at rest [mm].
        step_ms: processor time of a step of 10 ms on one thread, median [ms].
    """

    element: str
    poisson_ratio: float
    nodes: int
    bend: float
    step_ms: float


def measure_costs(meshes: Sequence[Any] = MESHES) -> list[Cost]:
    """Bend and time of a step, by element, Poisson's ratio and mesh.

    Raises:
        TaichisoftError: the finger does not come to rest on one of the meshes.
    """
    costs = []
    for poisson_ratio in POISSON_RATIOS:
        for element in ELEMENTS:
            for mesh in meshes[:-1] if element == "quadratic" and len(meshes) > 1 else meshes:
                body: dict[str, Any] = {"element": element, "poisson_ratio": poisson_ratio}
                _, _, bent = bend(mesh, damping=8.0, **body)
                nodes, step_ms = _step_time(mesh, body)
                costs.append(Cost(element, poisson_ratio, nodes, bent, step_ms))
                print(costs[-1], flush=True)
    return costs


def _step_time(mesh: Any, body: dict[str, Any]) -> tuple[int, float]:
    """Number of nodes, and processor time of a step while the shipped finger inflates [ms]."""
    from taichisoft.control import Control
    from taichisoft.running import Simulation, load_scene
    from taichisoft.scene import scene_from_dict

    tables = load_scene("finger-inflated").model_dump(mode="json", exclude_none=True)
    tables["soft_bodies"]["finger"] |= {"mesh": mesh, **body}
    simulation = Simulation(scene_from_dict(tables))
    times = []
    for index in range(WARM_UP + STEPS):
        started = process_time()
        simulation.step(Control(pressure={"finger.cavity": 0.5 * index}))
        times.append(process_time() - started)
    return simulation.model.node_count, 1e3 * float(np.median(times[WARM_UP:]))


def draw_costs(costs: Sequence[Cost], path: Path) -> None:
    """Draw bend over nodes, and beside it over the time of a step."""
    from matplotlib.ticker import LogLocator, NullFormatter

    styles = {0.3: "-", 0.49: "--"}
    colours = dict(zip(ELEMENTS, ("tab:red", "tab:green", "tab:blue"), strict=True))
    with svg_axes(path, (7.2, 3.4), columns=2) as both:
        for axes, figure, label in zip(both, ("nodes", "step_ms"), ("nodes", "time per step [ms]"), strict=True):
            for poisson_ratio, style in styles.items():
                for element, colour in colours.items():
                    some = [one for one in costs if (one.element, one.poisson_ratio) == (element, poisson_ratio)]
                    axes.plot(
                        [getattr(one, figure) for one in some],
                        [one.bend for one in some],
                        f"o{style}",
                        color=colour,
                        markersize=4,
                        linewidth=1,
                        label=f"{element}, {poisson_ratio:g}",
                    )
            for limit in LIMITS.values():
                axes.axhline(limit, color="0.5", linewidth=1, linestyle=":")
            axes.set_xscale("log")
            axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axes.xaxis.set_major_formatter("{x:g}")
            axes.xaxis.set_minor_formatter(NullFormatter())
            axes.set_ylim(bottom=0)
            axes.set_xlabel(label)
        both[0].set_ylabel("bend of the finger at 30 kPa [mm]")
        both[1].legend(frameon=False, fontsize=7)
