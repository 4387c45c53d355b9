"""Time the cases of cases.toml and print `name.metric value`; nothing is asserted here.

    python benchmarks/run.py [--tutorial-meshes DIR] [CASE ...]

Median and spread (5th to 95th percentile) of the wall time per step [ms], the time to compile or load the kernels
and make the model [s], and the size of the problem. With --tutorial-meshes the fingers have the meshes of SOFA's
tutorial, so that the figures compare with those measured there.
"""

import argparse
import os
import platform
import time
import tomllib
from pathlib import Path

import numpy as np

import taichisoft
from taichisoft.run_command import make_controller

CASES = Path(__file__).with_name("cases.toml")


def main() -> None:
    """Run the chosen cases."""
    cases = tomllib.loads(CASES.read_text(encoding="utf-8"))
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case", nargs="*", choices=[*cases, []], help="names from cases.toml; all otherwise")
    parser.add_argument("--tutorial-meshes", type=Path, metavar="DIR", help="folder with pneunetCutCoarse.vtk etc.")
    options = parser.parse_args()
    load = os.getloadavg()[0]
    print(f"# {platform.machine()}, {os.cpu_count()} cores, load {load:.2f}, Python {platform.python_version()}")
    for name in options.case or cases:
        for metric, value in measure(cases[name], options.tutorial_meshes).items():
            print(f"{name}.{metric} {value}", flush=True)


def measure(case: dict, tutorial_meshes: Path | None) -> dict[str, str]:
    """Figures of one case, ready to print."""
    started = time.perf_counter()
    scene = taichisoft.load_scene(case["scene"], overrides(case, tutorial_meshes))
    simulation = taichisoft.Simulation(scene)
    controller = make_controller(scene, None)
    controller.reset(simulation.model)
    simulation.step(controller.control(simulation.observe()))
    prepared = time.perf_counter() - started
    reports = [simulation.step(controller.control(simulation.observe())) for _ in range(case["steps"] - 1)]
    figures = {"prepare_s": f"{prepared:.2f}", "nodes": str(simulation.model.node_count)}
    for metric, (first, last) in case["metrics"].items():
        some = reports[first:last]
        times = 1e3 * np.array([report.step_time for report in some])
        low, high = np.percentile(times, [5, 95])
        contacts, sweeps = np.mean([(report.contact_count, report.iterations) for report in some], axis=0)
        figures[metric] = (
            f"{np.median(times):.2f}  # {low:.2f} to {high:.2f}; {contacts:.0f} contacts, {sweeps:.0f} sweeps"
        )
    return figures


def overrides(case: dict, tutorial_meshes: Path | None) -> list[str]:
    """The meshes of a case as overrides of its scene."""
    body = f"soft_bodies.{case['finger']}"
    if tutorial_meshes is None:
        return [f'{body}.mesh="{case["mesh"]}"']
    folder = tutorial_meshes.resolve()
    return [
        f'{body}.mesh="{folder / case["tutorial_mesh"]}"',
        f'{body}.collision_surface="{folder / "pneunetCut.stl"}"',
        f'{body}.cavities.cavity={{surface = "{folder / "pneunetCavityCut.stl"}"}}',
    ]


if __name__ == "__main__":
    main()
