"""Faults of mechanics: domains at rest without axes of stretch, and scenes whose walls explode."""

import json
import os
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from taichisoft.base import PYTHON
from taichisoft_benchmarks.regular_meshes import bar, hollow_sphere
from taichisoft_benchmarks.studies.one_body import simulation_of

EXPLODING = """
[time]
step = 0.01
duration = 0.5
[controller]
name = "scripted"
settings = {{ script = "inflate", pressure = {pressure} }}
[limits]
pressure_rate = 1e4
[soft_bodies.ball]
mesh = "ball.msh"
material = "{material}"
rayleigh_stiffness = 0.02
cavities = {{ air = {{ group = "cavity" }} }}
"""
SOFT = ("ecoflex-00-10", "ecoflex-00-30", "ecoflex-00-50", "dragon-skin-fx-pro-slacker")
BEYOND = 6.0
"""Twice the stretch up to which these materials are fitted."""


def matrices(tries: int) -> list[str]:
    """A million symmetric matrices each, 1 + noise of 1 to 8 units in the last place: eigenvectors are a rotation."""
    from taichisoft.runtime import Matrices, kernel, symmetric_eigen, ti

    @kernel
    def axes_of(symmetric: Matrices, axes: Matrices):  # type: ignore[no-untyped-def]
        ti.loop_config(serialize=True)
        for i in range(symmetric.shape[0]):
            _values, axes[i] = symmetric_eigen(symmetric[i])

    failures = []
    for number in range(tries):
        random = np.random.default_rng(number)
        noise = random.integers(-16, 17, (10**6, 1, 1)) * np.eye(3) + random.integers(-16, 17, (10**6, 3, 3)) / 4.0
        noise = 2.0**-53 * (np.triu(noise) + np.triu(noise, 1).transpose(0, 2, 1))
        symmetric, axes = (-1.0) ** number * np.eye(3) + noise, np.zeros((10**6, 3, 3))
        axes_of(symmetric, axes)
        bad = ~(np.abs(axes.transpose(0, 2, 1) @ axes - np.eye(3)).max(axis=(1, 2)) < 1e-14)
        failures += [f"{number}: {int(bad.sum())} matrices without axes"] if bad.any() else []
    return failures


def turned_meshes(tries: int) -> list[str]:
    """Boxes of smoothed rubber at rest, turned at random: a step leaves them where they are."""
    from taichisoft.errors import TaichisoftError

    failures = []
    for number in range(tries):
        random = np.random.default_rng(number)
        box = bar(tuple(random.integers(2, 6, 3)), tuple(random.uniform(5.0, 60.0, 3)))
        turn = Rotation.random(rng=random).as_euler("xyz", degrees=True).tolist()
        ratio = float(random.uniform(0.3, 0.499))
        keys: dict[str, Any] = {"law": "neo-hookean", "young_modulus": 200.0, "poisson_ratio": ratio, "rotation": turn}
        try:
            simulation = simulation_of(box, {}, **keys)
            simulation.step()
        except TaichisoftError as error:
            failures.append(f"{number}: {error}")
            continue
        if not np.abs(simulation.state.position - simulation.model.rest_position).max() < 1e-8:
            failures.append(f"{number}: moves at rest")
    return failures


def exploded_scenes(tries: int) -> list[str]:
    """Balloons of soft silicone under 1 to 100 kPa: a run that ends far beyond its law has not completed."""
    from taichisoft.mesh import write_volume_mesh

    failures = []
    for number in range(tries):
        random = np.random.default_rng(number)
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            write_volume_mesh(hollow_sphere(10.0, float(random.uniform(10.5, 13.0)), 2, 1), folder / "ball.msh")
            pressure, material = 10.0 ** random.uniform(0.0, 2.0), SOFT[random.integers(len(SOFT))]
            (folder / "ball.toml").write_text(EXPLODING.format(pressure=pressure, material=material))
            words = ["run", "ball.toml", "--outputs", "metrics", "-o", "out"]
            run = subprocess.run(
                [*PYTHON, "-m", "taichisoft", *words],
                cwd=folder,
                env={**os.environ, "TAICHISOFT_THREADS": "1"},
                capture_output=True,
                text=True,
            )
            figures = json.loads((folder / "out" / "metrics.json").read_text())
            inside_out = figures.get("inverted_elements_at_end", 0)
            burst = inside_out or figures.get("stretch_99_percent", {}).get("ball", 1.0) > BEYOND
            if bool(burst) == (run.returncode == 0) and figures["outcome"].startswith(("completed", "beyond")):
                failures.append(f"{number}: exit code {run.returncode}, {inside_out} inside out: {figures['outcome']}")
    return failures


ROWS: dict[str, tuple[int, Callable[[int], list[str]]]] = {
    "sets of a million matrices that are isotropic but for round-off": (10, matrices),
    "boxes of smoothed rubber, turned at random": (200, turned_meshes),
    "balloons of soft silicone that explode, or do not": (60, exploded_scenes),
}
