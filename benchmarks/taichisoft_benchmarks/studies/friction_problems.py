"""Contact problems of other programs: what the contact solver and a plain Gauss-Seidel make of them, as a table.

    python -m taichisoft_benchmarks.studies.friction_problems FOLDER

FOLDER holds problems as .npz files: W in compressed rows (`data`, `indices`, `indptr`), `q` and `mu`, three rows for
each contact, the normal one first. Sought are impulses r with u = W r + q, Signorini's and Coulomb's laws, as in the
collection FCLIB (Acary, Bremond, Koziara and Perignon 2014, FCLIB: a collection of discrete 3D frictional contact
problems).
"""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer
from scipy.sparse import csr_matrix

from taichisoft.solver import BOUND_COLUMNS, SWEEPS, ContactSolver, Iterate, Problem, sweep_repeatedly
from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.program import run_program

TOLERANCE = 1e-8
"""Residual at which both methods stop, as a share of the largest entry of q [-]."""
PLAIN_SWEEPS = 10_000
MOST_ITERATIONS = 1000


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
    """Read a problem; the symmetric part of W is taken.

    Raises:
        BenchmarkError: it cannot be read.
    """
    try:
        with np.load(path) as file:
            q, mu = file["q"], file["mu"]
            w = csr_matrix((file["data"], file["indices"], file["indptr"]), shape=(len(q), len(q))).toarray()
    except (OSError, ValueError, KeyError) as error:
        raise BenchmarkError(f"{path}: is not a contact problem: {error}") from error
    return FrictionProblem(path.stem, 0.5 * (w + w.T), q, mu)


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


def main(folder: Annotated[Path, typer.Argument(help="Folder of .npz files.")]) -> None:
    """Solve contact problems of Siconos and LMGC90 by the engine's solver, beside a plain projected Gauss-Seidel."""
    problems = [read_problem(path) for path in sorted(folder.glob("*.npz"))]
    if not problems:
        raise BenchmarkError(f"{folder}: has no .npz files")
    print("| problem | contacts | natural map | sweeps | s | Gauss-Seidel: natural map | sweeps | s |")
    print("|---|---|---|---|---|---|---|---|")
    for problem in problems:
        answers = (solve(problem), sweep_alone(problem))
        cells = [f"{one.natural_map:.1e} | {one.sweeps} | {one.seconds:.2f}" for one in answers]
        print(f"| {problem.name} | {len(problem.mu)} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    run_program(main, "taichisoft_benchmarks.studies.friction_problems")
