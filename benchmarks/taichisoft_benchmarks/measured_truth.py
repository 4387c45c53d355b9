"""Measurements beside simulations, with the errors of mesh and step: the sections of docs/measured.md.

    python -m taichisoft_benchmarks.measured_truth --measured DIR --output docs/measured.md

fills all sections in two minutes, and draws ring-down.svg beside the page. DIR holds `beam/` (the takes of
srl-ethz/diffPD_sim2real, MIT licence) and `materials/` (the tension tests of the Soft Robotics Materials Database,
NAME.csv), which are not part of the project; a section without its data says so. `--case FOLDER` adds a case as
`taichisoft new measured-case` begins it.
"""

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
import typer
from scipy.optimize import brentq, curve_fit

from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.one_body import TO_REST, WEAK, at_rest, simulation_of, traction
from taichisoft_benchmarks.pages import PageOption, fill_section, heading, row, run_program, svg_axes
from taichisoft_benchmarks.regular_meshes import bar
from taichisoft_outputs.material_files import shipped_materials
from taichisoft_outputs.tension_test import nominal_stress, read_tension_test
from taichisoft_studies.errors import StudyError
from taichisoft_studies.least_squares import (
    Calibration,
    Measurement,
    experiment_job,
    read_measurement,
    scaled_differences,
)
from taichisoft_studies.refinement import (
    MESH_ORDER,
    changed,
    finer_meshes,
    mesh_ratio,
    node_counts,
    refinement_error,
    time_order,
)
from taichisoft_studies.run_job import make_run
from taichisoft_studies.study_file import check_study, find_study, read_tables, scene_with
from taichisoft_studies.sweep_runs import fixed_overrides

if TYPE_CHECKING:  # a simulation brings Taichi
    from taichisoft.contact import Model
    from taichisoft.running import Simulation

BEAM = (100.0, 30.0, 30.0)
"""Size of the measured beam of Dragon Skin 10 [mm], clamped at one end."""
BEAM_BODY: dict[str, Any] = {"young_modulus": 255.0, "poisson_ratio": 0.499, "density": 1.07e-6}
BEAM_CLAMP = {"box": [[0.0, 0.0, 0.0], [0.0, *BEAM[1:]]]}
GRAVITY = (0.0, 0.0, -9810.0)


class Load(NamedTuple):
    """A weight at the upper edge of the beam's tip: its name on the page, its force [mN] and its mass [kg]."""

    name: str
    force: float
    mass: float


LOADS = {
    "gravity": Load("own weight", 0.0, 0.0),
    "load52": Load("52 g", 510.0, 0.052),
    "load101": Load("101 g", 1000.6, 0.102),
}
"""By their name in the files of the takes."""
TAKES = ("a", "b")
MARKERS = slice(1, 10)
"""Columns of the three markers at the tip: x, y and z of each [mm]."""

MESHES = ((7, 2, 2), (13, 4, 4), (27, 8, 8))
"""Cells of the beam's meshes of smoothed elements: each has half the size of the one before."""
SWINGING = ((10, 3, 3), (20, 6, 6))
"""Cells of the meshes on which it swings."""
STEP = 5e-4
"""Time step [s]. Implicit Euler damps an oscillation like Rayleigh's factor b = h, which is taken off the fitted b."""
SECONDS = 1.0
"""Simulated time of a swing."""

PULLED = 2.0
"""Stretch at whose measured stress the engine's block is pulled [-]."""
SMALL_STRAINS = (0.05, 0.1)
MISSED = 0.1
"""Error beyond which a figure stands in bold [-]."""
CASE = "case.toml"


def beam(cells: tuple[int, int, int], time: dict[str, Any], **body: Any) -> "Simulation":
    """The clamped beam in its moulded shape, under its own weight."""
    keys = {"anchors": [BEAM_CLAMP], **BEAM_BODY, **body}
    simulation: Simulation = simulation_of(bar(cells, BEAM), time, GRAVITY, **keys)
    return simulation


def beam_at_rest(element: str, cells: tuple[int, int, int], load: float, **body: Any) -> np.ndarray:
    """Displacements and rest positions of the beam's nodes [mm] under its weight and a force at its tip.

    Args:
        element: kind of element.
        cells: number of cells of the mesh along each edge.
        load: force down at the upper edge of the tip [mN].
        body: keys of the soft body instead of those of `BEAM_BODY`.
    """
    length, width, height = BEAM
    upper_edge = [[length, 0.0, height], [length, width, height]]
    edge = {"box": upper_edge, "directions": ["z"], "stiffness": WEAK}

    def dead_load(model: "Model") -> np.ndarray:
        shares = edge_shares(model.rest_position)
        return np.column_stack([np.zeros((len(shares), 2)), -load * shares])

    keys = {"element": element, "anchors": [BEAM_CLAMP, edge], **(body or {"law": "neo-hookean", **BEAM_BODY})}
    return at_rest(bar(cells, BEAM), gravity=GRAVITY, dead_load=dead_load, ramp=4, **keys)


def beam_sag(element: str, cells: tuple[int, int, int], load: float, **body: Any) -> float:
    """Displacement of the beam's tip [mm]; the arguments are those of `beam_at_rest`."""
    motion, rest = beam_at_rest(element, cells, load, **body)
    return float(np.linalg.norm(motion[np.isclose(rest[:, 0], BEAM[0])].mean(axis=0)))


def edge_shares(rest: np.ndarray) -> np.ndarray:
    """Shares of the nodes in a load on the upper edge of the beam's tip; its ends carry half as much as the rest."""
    length, width, height = BEAM
    on_edge = np.isclose(rest[:, 0], length) & np.isclose(rest[:, 2], height)
    share = np.where(on_edge, np.where(np.isclose(np.abs(rest[:, 1] - width / 2), width / 2), 0.5, 1.0), 0.0)
    return np.asarray(share / share.sum())


def beam_section(folder: Path) -> Iterator[str]:
    """Sag and first frequency under three loads: the modulus is fitted to one of these figures, the others follow."""
    swings = measured_swings(folder)
    rests = {load: [take.rest for take in takes] for load, takes in swings.items()}
    modulus = fitted_modulus(float(np.mean(rests["gravity"])))
    body = {"law": "neo-hookean", **BEAM_BODY, "young_modulus": modulus}
    yield f"Fitted to the sag under its own weight: E = {modulus:.0f} kPa.\n"
    yield heading(["", "measured, two takes", "simulated", "error of the finest mesh", "off"])
    for load, takes in rests.items():
        limit, error = limit_of_meshes(sags(load, body))
        off = "(fitted)" if load == "gravity" else None
        yield _compared(f"sag, {LOADS[load].name} [mm]", takes, limit, [error], off)
    for load in list(LOADS)[1:]:
        limit, error = limit_of_meshes([beam_frequency(load, cells, body) for cells in MESHES])
        takes = [take.frequency for take in swings[load]]
        yield _compared(f"frequency, {LOADS[load].name} [Hz]", takes, limit, [error])
    material = {"material": "dragon-skin-10", "density": BEAM_BODY["density"]}
    for load, takes in rests.items():
        limit, error = limit_of_meshes(sags(load, material))
        yield _compared(f"sag, {LOADS[load].name} [mm], law of the tension test", takes, limit, [error])


def sags(load: str, body: dict[str, Any]) -> list[float]:
    """Displacement of the beam's tip under a load on each mesh [mm]."""
    return [beam_sag("smoothed", cells, LOADS[load].force, **body) for cells in MESHES]


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
    here, it is exact to 0.2 %. The matrix of the engine's steps is made positive, and so is too stiff.
    """
    more, weight = 10.0, LOADS[load]
    motion, rest = beam_at_rest("smoothed", cells, weight.force, **body)
    shape = beam_at_rest("smoothed", cells, weight.force + more, **body)[0] - motion
    elasticity = simulation_of(bar(cells, BEAM), {"step": 1.0}, **body).model.elasticity
    shares = edge_shares(rest)
    mass = elasticity.node_mass + weight.mass * shares
    return float(np.sqrt(-more * (shares @ shape[:, 2]) / (mass @ (shape**2).sum(axis=1))) / (2 * np.pi))


@dataclass(frozen=True)
class Swing:
    """An oscillation about rest, from its first peak on.

    Attributes:
        time: since the peak [s], shape (count,).
        displacement: of the tip from the moulded shape, in the direction of rest [mm], shape (count,).
        rest: displacement at rest [mm].
        frequency: [Hz].
        decay: g of the envelope exp(-g t) [1/s].
    """

    time: np.ndarray
    displacement: np.ndarray
    rest: float
    frequency: float
    decay: float

    @classmethod
    def of(cls, time: np.ndarray, displacement: np.ndarray, rest: float) -> "Swing":
        """Fit a damped oscillation to displacements [mm] that begin at a peak at time 0 [s]; frequency to 1e-3."""

        def oscillation(t: np.ndarray, size: float, decay: float, turning: float, phase: float, mean: float) -> Any:
            return mean + size * np.exp(-decay * t) * np.cos(turning * t + phase)

        around = displacement - rest
        crossings = np.flatnonzero((around[:-1] > 0) & (around[1:] <= 0))[:6]
        period = np.diff(time[crossings]).mean()
        first = (float(around[0]), 2.0, 2 * np.pi / period, 0.0, rest)
        (_, decay, turning, *_), _ = curve_fit(oscillation, time, displacement, first)
        return cls(time, displacement, rest, float(turning / (2 * np.pi)), float(decay))


def measured_swing(path: Path) -> Swing:
    """The mean of the tip's markers in a recorded take."""
    try:
        table = np.genfromtxt(path, delimiter=",", skip_header=1)
        tip = table[:, MARKERS].reshape(len(table), 3, 3).mean(axis=1)
    except (OSError, ValueError, IndexError) as error:
        raise BenchmarkError(f"{path}: cannot be read as a table of markers: {error}") from error
    motion = tip - tip[0]
    resting = motion[-50:].mean(axis=0)
    rest = float(np.linalg.norm(resting))
    displacement = motion @ resting / rest
    peak = int(displacement.argmax())
    return Swing.of(table[peak:, 0] - table[peak, 0], displacement[peak:], rest)


def measured_swings(folder: Path) -> dict[str, list[Swing]]:
    """The takes by load."""
    name = "realbeam_experiments__beam_{}_V2_{}.csv"
    return {load: [measured_swing(folder / name.format(load, take)) for take in TAKES] for load in LOADS}


def rayleigh_damping(swings: dict[str, list[Swing]]) -> tuple[float, float]:
    """Rayleigh's factors a [1/s] and b [s] by least squares of g = a / 2 + b (2 pi f)^2 / 2 over all loads.

    With them the beam swings at frequencies between 3.4 and 7.8 Hz.
    """
    every = [swing for takes in swings.values() for swing in takes]
    turning = 2 * np.pi * np.array([swing.frequency for swing in every])
    table = 0.5 * np.column_stack([np.ones(len(every)), turning**2])
    (a, b), *_ = np.linalg.lstsq(table, [swing.decay for swing in every])
    return float(a), float(b)


def simulated_swing(
    peak: float,
    damping: tuple[float, float],
    duration: float,
    cells: tuple[int, int, int] = MESHES[1],
    step: float = STEP,
    **body: Any,
) -> Swing:
    """The beam released at rest from where more gravity had brought its tip to `peak` [mm].

    Args:
        peak: displacement of the tip at the start over that at rest [-].
        damping: Rayleigh's factors a [1/s] and b [s].
        duration: [s].
        cells: of the mesh of smoothed elements.
        step: time step [s], shorter than b.
        body: keys of the soft body instead of those of `BEAM_BODY`.
    """
    from taichisoft.control import Control

    a, b = damping
    keys: dict[str, Any] = {"element": "smoothed", "law": "neo-hookean", "rayleigh_mass": a, **body}
    still = beam(cells, TO_REST, **keys)
    swinging = beam(cells, {"step": step}, rayleigh_stiffness=b - step, **keys)
    nodes = swinging.model.rest_position
    tip = np.isclose(nodes[:, 0], BEAM[0])
    still.step()
    resting = (still.state.position - nodes)[tip].mean(axis=0)
    rest = float(np.linalg.norm(resting))
    still.step(Control(gravity=peak * np.array(GRAVITY)))
    swinging.restore(swinging.state.changed(position=still.state.position))
    moved = [still.state.position]
    for _ in range(round(duration / step)):
        swinging.step()
        moved.append(swinging.state.position)
    displacement = np.array([(position - nodes)[tip].mean(axis=0) @ resting / rest for position in moved])
    return Swing.of(step * np.arange(len(moved)), displacement, rest)


def ring_down_section(folder: Path, picture: Path | None) -> Iterator[str]:
    """Frequency and decay of the beam that was let go, from its first peak on."""
    swings = measured_swings(folder)
    takes = swings["gravity"]
    damping = rayleigh_damping(swings)
    body = {"young_modulus": fitted_modulus(float(np.mean([take.rest for take in takes])))}
    peak = float(np.mean([take.displacement[0] / take.rest for take in takes]))
    fine, long_steps, coarse = (
        simulated_swing(peak, damping, SECONDS, cells, step, **body)
        for cells, step in ((SWINGING[1], STEP), (SWINGING[1], 2 * STEP), (SWINGING[0], 2 * STEP))
    )
    if picture is not None:
        draw(takes, fine, picture)
    yield f"Fitted to the decays under all loads: a = {damping[0]:.2f} 1/s, b = {1e3 * damping[1]:.2f} ms.\n"
    yield heading(["", "measured, two takes", "simulated", "error by the step", "error by the mesh", "off"])
    figures: dict[str, Callable[[Swing], float]] = {
        "frequency [Hz]": lambda swing: swing.frequency,
        "decay [1/s]": lambda swing: swing.decay,
    }
    for name, of in figures.items():
        step, mesh = of(long_steps) - of(fine), of(coarse) - of(long_steps)
        errors = [refinement_error(step, 0.0, 2.0, 1.0) - step, refinement_error(mesh, 0.0, 2.0, 2.0) - mesh]
        yield _compared(name, [of(take) for take in takes], of(fine), errors)


def draw(measured: list[Swing], simulated: Swing, path: Path) -> None:
    """Draw the simulated swing over the takes, as SVG."""
    with svg_axes(path, (7.0, 3.2)) as axes:
        for name, take, marker in zip(TAKES, measured, "ox", strict=True):
            shown = take.time < simulated.time[-1]
            style = {"ms": 3, "mfc": "none", "color": "0.45", "label": f"measured, take {name}"}
            axes.plot(take.time[shown], take.displacement[shown], marker, **style)
        axes.plot(simulated.time, simulated.displacement, color="C0", lw=1.2, label="simulated")
        axes.set_xlabel("time since the first peak [s]")
        axes.set_ylabel("tip [mm]")
        axes.set_xlim(0.0, simulated.time[-1])
        axes.legend(frameon=False)


def tension_section(folder: Path) -> Iterator[str]:
    """Every shipped law beside its test: at a stretch of 2, at small strains, and where the specimen failed."""
    pulled = f"engine's stretch under the stress measured at {PULLED:g}"
    small = f"stress at {SMALL_STRAINS[0]:.0%} to {SMALL_STRAINS[1]:.0%}, law over test"
    yield heading(["", pulled, small, "failed at a stretch of", "stress there, law over test"])
    missing, files = [], {path.stem: path for path in folder.glob("*.csv")}
    for name, material in shipped_materials().items():
        if material.name not in files:
            missing.append(f"{material.name}.csv")
            continue
        test = read_tension_test(files[material.name])
        stress = nominal_stress(material.law, material.coefficients, test.stretch)
        low = (test.stretch >= 1 + SMALL_STRAINS[0]) & (test.stretch <= 1 + SMALL_STRAINS[1])
        failed = int(test.stress.argmax())
        there = float(np.interp(PULLED, test.stretch[: failed + 1], test.stress[: failed + 1]))
        ratios = [_ratio(stress[low] / test.stress[low]), _ratio(stress[failed : failed + 1] / test.stress[failed])]
        yield row(
            [f"`{name}`", f"{pulled_stretch(name, there):.2f}", ratios[0], f"{test.stretch[failed]:.2f}", ratios[1]]
        )
    if missing:
        yield f"\nLeft out: {', '.join(missing)} (not in the folder)."


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
    text = off or (f"**{relative:+.1%}**" if abs(relative) > MISSED else f"{relative:+.1%}")
    takes = ", ".join(f"{take:.2f}" for take in measured)
    return row([name, takes, f"{simulated:.2f}", *(f"{error:+.2f}" for error in errors), text])


def case_lines(folder: Path) -> Iterator[str]:
    """The curves of a case, with its parameters at their start: what is simulated is no fit."""
    if not (folder / CASE).is_file():
        raise BenchmarkError(f"--case {folder}: has no {CASE}; `taichisoft new measured-case` writes one")
    path = find_study(str(folder / CASE))
    study = check_study(Calibration, read_tables(path), str(path))
    values = {key: parameter.start for key, parameter in study.parameters.items()}
    scene = scene_with(study.scene, {**fixed_overrides(study), **values}, study.controller)
    changes, remark = finer_meshes(scene)
    finer_scenes = {"step": [f"time.step={scene.time.step / 2!r}"], **({"mesh": changes} if changes else {})}
    variants = {name: study.model_copy(update={"set": (*study.set, *keys)}) for name, keys in finer_scenes.items()}
    ratio = mesh_ratio(*node_counts(scene, changed(scene, changes))) if changes else 1.0
    yield f"\n### {folder.name}: {scene.title}\n"
    yield heading(
        ["", "rows", "off, root mean square", "error of measurement", "error by the step", "error by the mesh"]
    )
    with tempfile.TemporaryDirectory() as runs:
        for index, experiment in enumerate(study.experiments):
            file = path.parent / (experiment.data or "")
            try:
                data = read_measurement(experiment, file, f"{path}: experiments.{index}")
            except StudyError as problem:
                yield row([f"left out: {problem}", *[""] * 5])
                continue
            off = _differences(study, index, data, values, Path(runs))
            finer = {
                name: _differences(finer_study, index, data, values, Path(runs))
                for name, finer_study in variants.items()
            }
            by_step = refinement_error(off, finer["step"], 2.0, time_order(scene))
            by_mesh = refinement_error(off, finer["mesh"], ratio, MESH_ORDER) if changes else None
            for number, curve in enumerate(experiment.curves):
                bars = ["not known" if error is None else _size(error[number]) for error in (by_step, by_mesh)]
                scale = f"{data.scales[number]:.3g}"
                yield row([curve.column, len(data.over), _size(off[number]), scale, *bars])
    if remark:
        yield f"\nWithout error by the mesh: {remark}."


def _size(differences: np.ndarray) -> str:
    return f"{np.sqrt((differences**2).mean()):.3g}"


def _differences(
    study: Calibration, index: int, data: Measurement, values: dict[str, float], folder: Path
) -> np.ndarray:
    """Run less data, in the unit of each curve, shape (curve_count, row_count)."""
    job = experiment_job(study, index, values, folder)
    found = scaled_differences(job, make_run(job), data, study, index)
    return found.reshape(data.curves.shape) * data.scales[:, None]


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
    fill_section(output, "cases", (line for folder in case for line in case_lines(folder)) if case else none)


if __name__ == "__main__":
    run_program(main, "taichisoft_benchmarks.measured_truth")
