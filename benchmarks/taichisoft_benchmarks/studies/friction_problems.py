"""Contact problems of other programs: what the contact solver and a plain Gauss-Seidel make of them.

    python -m taichisoft_benchmarks.studies.friction_problems FOLDER --output docs/friction.md

FOLDER holds problems of FCLIB or Siconos (friction_files.py); the section "problems" of the page is filled. Sought are
impulses r with u = W r + q, Signorini's and Coulomb's laws (Acary, Bremond, Koziara and Perignon 2014, FCLIB: a
collection of discrete 3D frictional contact problems).
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer

from taichisoft.contact import BOUND_COLUMNS, SWEEPS, ContactSolver, Iterate, Problem, sweep_repeatedly
from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.marked_page import PageOption, fill_section, heading, row
from taichisoft_benchmarks.program import run_program
from taichisoft_benchmarks.studies.friction_files import READERS, read_local_problem

TOLERANCE = 1e-8
"""Residual at which both methods stop, as a share of the largest entry of q [-]."""
PLAIN_SWEEPS = 10_000
MOST_ITERATIONS = 1000
BARS = (1e-4, 1e-8, 1e-12)
"""Natural maps that are counted [-]."""
HEADINGS = (
    "problem", "contacts", "natural map", "sweeps", "s", "Gauss-Seidel: natural map", "sweeps", "s",
)  # fmt: skip


@dataclass(frozen=True)
class FrictionProblem:
    """Impulses r are sought with u = W r + q: W of shape (3 n, 3 n), q of (3 n,), friction coefficients mu of (n,)."""

    name: str
    w: np.ndarray
    q: np.ndarray
    mu: np.ndarray

    def engine_problem(self) -> Problem:
        """As the engine has it."""
        size = np.array([len(self.mu), 0, 0], dtype=np.int32)
        bounds = np.zeros((0, BOUND_COLUMNS))
        return Problem.without_moments(size, self.w.reshape(-1).copy(), self.q.copy(), self.mu.copy(), bounds)

    def natural_map(self, impulse: np.ndarray) -> float:
        """|r - P(r - u - mu |u_t| n)| / |q| with the projection P on Coulomb's cones: 0 where r is a solution [-]."""
        velocity = (self.w @ impulse + self.q).reshape(-1, 3)
        velocity[:, 0] += self.mu * np.hypot(velocity[:, 1], velocity[:, 2])
        missed = impulse - project_on_cones(impulse - velocity.reshape(-1), self.mu)
        return float(np.linalg.norm(missed) / np.linalg.norm(self.q))


class MethodResult(NamedTuple):
    """What a method found: natural map [-], sweeps, processor time [s]."""

    natural_map: float
    sweeps: int
    seconds: float


def read_problem(path: Path) -> FrictionProblem:
    """Read a problem.

    Raises:
        BenchmarkError: it cannot be read.
    """
    return FrictionProblem(path.stem, *read_local_problem(path))


def project_on_cones(values: np.ndarray, friction: np.ndarray) -> np.ndarray:
    """The nearest values with |v_t| <= mu v_n at each contact, shape (3 n,)."""
    points = values.reshape(-1, 3)
    normal, tangential = points[:, 0], np.hypot(points[:, 1], points[:, 2])
    on_side = np.maximum(normal + friction * tangential, 0.0) / (1.0 + friction**2)
    inside = tangential <= friction * normal
    projected = np.where(inside, normal, on_side)
    shrink = np.where(inside, 1.0, friction * projected / np.maximum(tangential, 1e-300))
    return np.column_stack([projected, shrink[:, None] * points[:, 1:]]).reshape(-1)


def solve(problem: FrictionProblem) -> MethodResult:
    """By the engine's solver, from no impulses."""
    solver = ContactSolver(problem.engine_problem())
    solver.impulse[:] = 0.0
    started = time.process_time()
    solver.solve(TOLERANCE * np.abs(problem.q).max(), MOST_ITERATIONS)
    seconds = time.process_time() - started
    return MethodResult(problem.natural_map(solver.impulse), solver.iterations, seconds)


def sweep_alone(problem: FrictionProblem) -> MethodResult:
    """By a plain projected Gauss-Seidel, from no impulses."""
    iterate = Iterate(np.zeros(len(problem.q)), np.zeros(len(problem.q)))
    outcome = np.zeros(2)
    started = time.process_time()
    sweep_repeatedly(
        problem.engine_problem(), iterate, outcome, TOLERANCE * float(np.abs(problem.q).max()), PLAIN_SWEEPS
    )
    seconds = time.process_time() - started
    return MethodResult(problem.natural_map(iterate.impulse), int(outcome[SWEEPS]), seconds)


def lines(problems: Sequence[FrictionProblem]) -> Iterator[str]:
    """A table of the problems, and one of how many are solved how well."""
    yield heading(HEADINGS)
    answers = []
    for problem in problems:
        answers.append((solve(problem), sweep_alone(problem)))
        cells = [f"{one.natural_map:.1e} | {one.sweeps} | {one.seconds:.2f}" for one in answers[-1]]
        yield row([problem.name, len(problem.mu), *cells])
    yield f"\n{heading(['solved, of ' + str(len(problems)), *(f'natural map below {bar:g}' for bar in BARS)])}"
    for number, method in enumerate(("taichisoft", "plain Gauss-Seidel")):
        maps = [both[number].natural_map for both in answers]
        yield row([method, *(sum(one < bar for one in maps) for bar in BARS)])


def main(
    folder: Annotated[Path, typer.Argument(help="Folder of problems: .hdf5, .h5, .dat, .npz.")],
    output: PageOption = None,
) -> None:
    """Solve contact problems of other programs by the engine's solver, beside a plain projected Gauss-Seidel."""
    problems = [read_problem(path) for path in sorted(folder.iterdir()) if path.suffix in READERS]
    if not problems:
        raise BenchmarkError(f"{folder}: has none of {', '.join(READERS)}")
    fill_section(output, "problems", lines(problems))


if __name__ == "__main__":
    run_program(main, "taichisoft_benchmarks.studies.friction_problems")
