"""What was measured beside what is simulated, with the errors of mesh and step: the sections of docs/measured.md.

    python -m taichisoft_benchmarks.studies.measured_truth --measured DIR --output docs/measured.md

fills all sections, in two minutes, and draws ring-down.svg beside the page. DIR holds `beam/` (the takes of
srl-ethz/diffPD_sim2real) and `materials/` (the tension tests of the Soft Robotics Materials Database, NAME.csv), which
are not part of the project; what is missing is left out, and the page says so. `--case FOLDER` adds a case as
`taichisoft new measured-case` begins it.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from scipy.optimize import brentq

from taichisoft_benchmarks.marked_page import PageOption, fill_section, heading, row
from taichisoft_benchmarks.program import run_program
from taichisoft_benchmarks.regular_meshes import bar
from taichisoft_benchmarks.studies.bending import traction
from taichisoft_benchmarks.studies.element_errors import (
    BEAM,
    BEAM_BODY,
    BEAM_LOADS,
    beam_at_rest,
    beam_sag,
    edge_shares,
)
from taichisoft_benchmarks.studies.measured_cases import case_lines
from taichisoft_benchmarks.studies.one_body import WEAK, at_rest, simulation_of
from taichisoft_benchmarks.studies.ring_down import (
    LOADS,
    STEP,
    Swing,
    draw,
    measured_swings,
    rayleigh_damping,
    simulated_swing,
)
from taichisoft_outputs.material_files import shipped_materials
from taichisoft_outputs.tension_test import nominal_stress, read_tension_test
from taichisoft_studies.refinement import refinement_error

MESHES = ((7, 2, 2), (13, 4, 4), (27, 8, 8))
"""Cells of the beam's meshes of smoothed elements: each has half the size of the one before."""
SWINGING = ((10, 3, 3), (20, 6, 6))
"""Cells of the meshes on which it swings."""
MASSES = dict(zip(LOADS, (0.0, 0.052, 0.102), strict=True))
"""Of the weights at the tip [kg]: their forces over g."""
NAMES = dict(zip(LOADS, BEAM_LOADS, strict=True))
SECONDS = 1.0
"""Simulated time of a swing."""
PULLED = 2.0
"""Stretch at whose measured stress the engine's block is pulled [-]."""
SMALL_STRAINS = (0.05, 0.1)
MISSED = 0.1
"""Error beyond which a figure stands in bold [-]."""


def beam_section(folder: Path) -> Iterator[str]:
    """Sag and first frequency under three loads: the modulus is fitted to one of these figures, the others follow."""
    swings = measured_swings(folder)
    rests = {load: [one.rest for one in takes] for load, takes in swings.items()}
    modulus = fitted_modulus(float(np.mean(rests["gravity"])))
    body = {"law": "neo-hookean", **BEAM_BODY, "young_modulus": modulus}
    yield f"Fitted to the sag under its own weight: E = {modulus:.0f} kPa.\n"
    yield heading(["", "measured, two takes", "simulated", "error of the finest mesh", "off"])
    for load, takes in rests.items():
        limit, error = limit_of_meshes(sags(load, body))
        off = "(fitted)" if load == "gravity" else None
        yield _compared(f"sag, {NAMES[load]} [mm]", takes, limit, [error], off)
    for load in LOADS[1:]:
        limit, error = limit_of_meshes([beam_frequency(load, cells, body) for cells in MESHES])
        takes = [take.frequency for take in swings[load]]
        yield _compared(f"frequency, {NAMES[load]} [Hz]", takes, limit, [error])
    material = {"material": "dragon-skin-10", "density": BEAM_BODY["density"]}
    for load, takes in rests.items():
        limit, error = limit_of_meshes(sags(load, material))
        yield _compared(f"sag, {NAMES[load]} [mm], law of the tension test", takes, limit, [error])


def sags(load: str, body: dict[str, Any]) -> list[float]:
    """Displacement of the beam's tip under a load on each mesh [mm]."""
    return [beam_sag("smoothed", cells, BEAM_LOADS[NAMES[load]], **body) for cells in MESHES]


def limit_of_meshes(values: list[float]) -> tuple[float, float]:
    """Limit of values on three meshes, each half as coarse as the one before, and the error of the last one.

    The order of convergence is that which the three show (Richardson's extrapolation).
    """
    first, second = values[1] - values[0], values[2] - values[1]
    error = refinement_error(values[1], values[2], 2.0, float(np.log2(first / second))) + second
    return values[2] - error, error


def fitted_modulus(sag: float) -> float:
    """Young's modulus [kPa] with which the beam sags so far under its own weight [mm], in the limit of the meshes."""

    def missing(modulus: float) -> float:
        body = {"law": "neo-hookean", **BEAM_BODY, "young_modulus": modulus}
        return limit_of_meshes(sags("gravity", body))[0] - sag

    return float(brentq(missing, 150.0, 450.0, xtol=0.1))


def beam_frequency(load: str, cells: tuple[int, int, int], body: dict[str, Any]) -> float:
    """First frequency [Hz] of small swings about rest with a weight at the tip, which swings along.

    Rayleigh's quotient with the shape that a little more load adds: for a mass at the tip above the beam's own, as
    here, it is exact to 0.2 %. The matrix of the engine's steps would not do: it is made positive, and so too stiff.
    """
    more, name = 10.0, NAMES[load]
    motion, rest = beam_at_rest("smoothed", cells, BEAM_LOADS[name], **body)
    shape = beam_at_rest("smoothed", cells, BEAM_LOADS[name] + more, **body)[0] - motion
    elasticity = simulation_of(bar(cells, BEAM), {"step": 1.0}, **body).model.elasticity
    shares = edge_shares(rest)
    mass = elasticity.node_mass + MASSES[load] * shares
    return float(np.sqrt(-more * (shares @ shape[:, 2]) / (mass @ (shape**2).sum(axis=1))) / (2 * np.pi))


def ring_down_section(folder: Path, picture: Path | None) -> Iterator[str]:
    """Frequency and decay of the beam that was let go, from its first peak on."""
    swings = measured_swings(folder)
    takes = swings["gravity"]
    damping = rayleigh_damping(swings)
    body = {"young_modulus": fitted_modulus(float(np.mean([one.rest for one in takes])))}
    peak = float(np.mean([one.displacement[0] / one.rest for one in takes]))
    fine, long_steps, coarse = (
        simulated_swing(peak, damping, SECONDS, cells, step, **body)
        for cells, step in ((SWINGING[1], STEP), (SWINGING[1], 2 * STEP), (SWINGING[0], 2 * STEP))
    )
    if picture is not None:
        draw(takes, fine, picture)
    yield f"Fitted to the decays under all loads: a = {damping[0]:.2f} 1/s, b = {1e3 * damping[1]:.2f} ms.\n"
    yield heading(["", "measured, two takes", "simulated", "error by the step", "error by the mesh", "off"])
    figures: dict[str, Callable[[Swing], float]] = {
        "frequency [Hz]": lambda one: one.frequency,
        "decay [1/s]": lambda one: one.decay,
    }
    for name, of in figures.items():
        step, mesh = of(long_steps) - of(fine), of(coarse) - of(long_steps)
        errors = [refinement_error(step, 0.0, 2.0, 1.0) - step, refinement_error(mesh, 0.0, 2.0, 2.0) - mesh]
        yield _compared(name, [of(one) for one in takes], of(fine), errors)


def tension_section(folder: Path) -> Iterator[str]:
    """Every shipped law beside its test: where it was fitted, at small strains, and where the specimen failed."""
    pulled = f"engine's stretch under the stress measured at {PULLED:g}"
    small = f"stress at {SMALL_STRAINS[0]:.0%} to {SMALL_STRAINS[1]:.0%}, law over test"
    yield heading(["", "fit, rms and worst", pulled, small, "failed at a stretch of", "stress there, law over test"])
    lost, files = [], {path.stem: path for path in folder.glob("*.csv")}
    for name, material in shipped_materials().items():
        if material.name not in files:
            lost.append(f"{material.name}.csv")
            continue
        test = read_tension_test(files[material.name])
        stress = nominal_stress(material.law, material.coefficients, test.stretch)
        fitted = (test.stretch >= 1.05) & (test.stretch <= material.highest_stretch)
        misfit = np.abs(stress - test.stress)[fitted] / test.stress[fitted].max()
        low = (test.stretch >= 1 + SMALL_STRAINS[0]) & (test.stretch <= 1 + SMALL_STRAINS[1])
        failed = int(test.stress.argmax())
        there = float(np.interp(PULLED, test.stretch[: failed + 1], test.stress[: failed + 1]))
        ratios = [_ratio(stress[low] / test.stress[low]), _ratio(stress[failed : failed + 1] / test.stress[failed])]
        fit = f"{np.sqrt((misfit**2).mean()):.1%}, {misfit.max():.1%}"
        cells = [f"`{name}`", fit, f"{pulled_stretch(name, there):.2f}", ratios[0], f"{test.stretch[failed]:.2f}"]
        yield row([*cells, ratios[1]])
    if lost:
        yield f"\nLeft out: {', '.join(lost)} (not in the folder)."


def pulled_stretch(material: str, stress: float) -> float:
    """Stretch of the engine's block of a shipped material under a force over its area at rest [kPa]."""
    side, beyond = 10.0, 10.1
    faces = [
        {"box": [[-0.1] * 3, [0.1 if other == axis else beyond for other in range(3)]], "directions": [name]}
        for axis, name in enumerate("xyz")
    ]
    pulled = {"box": [[side - 0.1, -0.1, -0.1], [beyond] * 3], "directions": ["x"], "stiffness": WEAK}
    load = traction(side, (stress * side**2, 0.0, 0.0))
    motion, rest = at_rest(
        bar((1, 1, 1), (side,) * 3), dead_load=load, ramp=8, material=material, anchors=[*faces, pulled]
    )
    return float(1 + motion[np.isclose(rest[:, 0], side), 0].mean() / side)


def _ratio(values: np.ndarray) -> str:
    """The mean of ratios, in bold where it is far from 1."""
    if not len(values):
        return "no points"
    mean = float(values.mean())
    return f"**{mean:.2f}**" if abs(mean - 1) > MISSED else f"{mean:.2f}"


def _compared(name: str, measured: list[float], simulated: float, errors: list[float], off: str | None = None) -> str:
    """A line: two takes, what is simulated, its errors, and how far it is off, in bold where that is much."""
    relative = simulated / float(np.mean(measured)) - 1
    said = off or (f"**{relative:+.1%}**" if abs(relative) > MISSED else f"{relative:+.1%}")
    takes = ", ".join(f"{one:.2f}" for one in measured)
    return row([name, takes, f"{simulated:.2f}", *(f"{one:+.2f}" for one in errors), said])


def main(
    measured: Annotated[Path, typer.Option("--measured", "-m", metavar="DIR", help="Folder of beam/ and materials/.")],
    case: Annotated[
        list[Path] | None, typer.Option(metavar="FOLDER", help="A case of `taichisoft new measured-case` (repeatable).")
    ] = None,
    output: PageOption = None,
) -> None:
    """Fill the sections of docs/measured.md: what was measured, what is simulated, and the errors of both."""
    picture = None if output is None else output.with_name("ring-down.svg")
    sections: dict[str, tuple[Path, Callable[[Path], Iterator[str]]]] = {
        "beam": (measured / "beam", beam_section),
        "ring-down": (measured / "beam", lambda folder: ring_down_section(folder, picture)),
        "tension": (measured / "materials", tension_section),
    }
    for name, (folder, lines) in sections.items():
        absent = [f"Left out: `{folder.name}/` is not in the folder of the measured data."]
        fill_section(output, name, lines(folder) if folder.is_dir() else absent)
    none = ["No case was given: `--case FOLDER` adds one."]
    fill_section(output, "cases", (line for one in case for line in case_lines(one)) if case else none)


if __name__ == "__main__":
    run_program(main, "taichisoft_benchmarks.studies.measured_truth")
