"""Contact problems of other programs, solved by the contact solver and by a plain Gauss-Seidel.

    python -m taichisoft_benchmarks.friction_problems FOLDER --output docs/friction.md

fills the section "problems" of the page. Impulses r are sought with u = W r + q and Signorini's and Coulomb's laws
(Acary, Bremond, Koziara and Perignon 2014, FCLIB: a collection of discrete 3D frictional contact problems). FOLDER has

| file | content |
|---|---|
| `.hdf5`, `.h5` | group `fclib_local`: W, q, mu; or `fclib_global`: M, H, f, w, mu; G, b of joints |
| `.dat` | Siconos's FrictionContactProblem: dimension, contacts, W dense or in blocks, q, mu |
| `.npz` | W in compressed rows (`data`, `indices`, `indptr`), `q` and `mu` |

A contact has three rows, the normal one first. A global problem M v = H r + G l + f, u = H^T v + w, 0 = G^T v + b
(Acary et al. 2014) becomes a local one, u = W r + q, by elimination of v and l. The symmetric part of W is
taken: in some files it is not quite symmetric.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import typer
from scipy.sparse import bmat, coo_matrix, csc_matrix, csr_matrix, spmatrix
from scipy.sparse.linalg import splu

from taichisoft.base import read_arrays
from taichisoft.contact import BOUND_COLUMNS, SWEEPS, ContactSolver, Iterate, Problem, sweep_repeatedly
from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.pages import PageOption, fill_section, heading, row, run_program

DENSE, BLOCKS = 0, 1
"""Kinds of matrices in Siconos's text files that are read."""
CSC, CSR = -1, -2
"""Kinds of matrices in FCLIB's files; from 0 on it is the number of triplets."""

Local = tuple[np.ndarray, np.ndarray, np.ndarray]
"""W of shape (3 n, 3 n), q of (3 n,), mu of (n,)."""

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
    """Read a problem."""
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


def read_local_problem(path: Path) -> Local:
    """Read a problem as W, q and mu."""
    if path.suffix not in READERS:
        raise BenchmarkError(f"{path}: is none of {', '.join(READERS)}")
    try:
        w, q, mu = READERS[path.suffix](path)
    except (OSError, ValueError, KeyError, IndexError) as error:
        raise BenchmarkError(f"{path}: is not a contact problem: {error}") from error
    if w.shape != (len(q), len(q)) or len(q) != 3 * len(mu):
        raise BenchmarkError(f"{path}: W {w.shape}, q {q.shape}, mu {mu.shape} do not fit three rows a contact")
    if not all(np.isfinite(part).all() for part in (w, q, mu)):
        raise BenchmarkError(f"{path}: has a number that is not finite")
    return 0.5 * (w + w.T), q, mu


def _read_archive(path: Path) -> Local:
    file = read_arrays(path)
    q = file["q"]
    w = csr_matrix((file["data"], file["indices"], file["indptr"]), shape=(len(q), len(q)))
    return w.toarray(), q, file["mu"]


def _read_fclib(path: Path) -> Local:
    import h5py

    with h5py.File(path) as file:
        kind = next((name for name in ("fclib_local", "fclib_global") if name in file), None)
        if kind is None:
            raise KeyError("neither fclib_local nor fclib_global is in it")
        group = file[kind]
        if int(np.ravel(group["spacedim"])[0]) != 3:
            raise ValueError("spacedim must be 3")
        vectors = {name: np.asarray(value, dtype=float) for name, value in group["vectors"].items()}
        if kind == "fclib_local":
            if "V" in group:
                raise ValueError("V and R, joints in a local problem, are not read")
            return _sparse(group["W"]).toarray(), vectors["q"], vectors["mu"]
        return _without_velocities(
            _sparse(group["M"]), _sparse(group["H"]), _sparse(group["G"]) if "G" in group else None, vectors
        )


def _sparse(group: Any) -> spmatrix:
    """A matrix of FCLIB: CSparse's compressed columns or rows, or triplets, whose `p` are columns."""
    m, n, nz = (int(np.ravel(group[name])[0]) for name in ("m", "n", "nz"))
    p, i, x = (np.asarray(group[name]) for name in ("p", "i", "x"))
    if nz == CSC:
        return csc_matrix((x, i, p), shape=(m, n))
    if nz == CSR:
        return csr_matrix((x, i, p), shape=(m, n))
    return coo_matrix((x[:nz], (i[:nz], p[:nz])), shape=(m, n)).tocsc()


def _without_velocities(m: spmatrix, h: spmatrix, g: spmatrix | None, vectors: dict[str, np.ndarray]) -> Local:
    """W = H^T M^-1 H and q = w + H^T M^-1 f, under the joints' 0 = G^T v + b."""
    n = m.shape[0]
    system, force = m, vectors["f"]
    if g is not None:
        system, force = bmat([[m, -g], [g.T, None]]), np.concatenate([force, -vectors["b"]])
    factor, rows = splu(csc_matrix(system)), len(force)
    pushes = np.zeros((rows, h.shape[1]))
    pushes[:n] = h.toarray()
    return h.T @ factor.solve(pushes)[:n], vectors["w"] + h.T @ factor.solve(force)[:n], vectors["mu"]


def _read_siconos(path: Path) -> Local:
    numbers = iter(path.read_text(encoding="utf-8").split())

    def integers(count: int) -> list[int]:
        return [int(next(numbers)) for _ in range(count)]

    def reals(count: int) -> np.ndarray:
        return np.array([float(next(numbers)) for _ in range(count)])

    try:
        dimension, contacts, kind, height, width = integers(5)
        if dimension != 3:
            raise ValueError(f"dimension {dimension}, must be 3")
        if kind == DENSE:
            w = reals(height * width).reshape(width, height).T
        elif kind == BLOCKS:
            w = _blocks(height, width, integers, reals)
        else:
            raise ValueError(f"storage {kind}, must be {DENSE} (dense) or {BLOCKS} (blocks)")
        return w, reals(height), reals(contacts)
    except StopIteration:
        raise ValueError("it ends too early") from None


def _blocks(
    height: int, width: int, integers: Callable[[int], list[int]], reals: Callable[[int], np.ndarray]
) -> np.ndarray:
    """Siconos's matrix of blocks, each with its columns one after another; sizes are cumulative."""
    w = np.zeros((height, width))
    _, down, across = integers(3)
    bottoms, rights = integers(down), integers(across)
    filled, entries = integers(2)
    begins, columns = integers(filled), integers(entries)
    for i in range(down):
        for k in range(begins[i], begins[i + 1]):
            j = columns[k]
            rows, cols = slice(bottoms[i - 1] if i else 0, bottoms[i]), slice(rights[j - 1] if j else 0, rights[j])
            integers(1)  # the block's number
            shape = (cols.stop - cols.start, rows.stop - rows.start)
            w[rows, cols] = reals(shape[0] * shape[1]).reshape(shape).T
    return w


READERS: dict[str, Callable[[Path], Local]] = {
    ".hdf5": _read_fclib,
    ".h5": _read_fclib,
    ".dat": _read_siconos,
    ".npz": _read_archive,
}


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
    run_program(main, "taichisoft_benchmarks.friction_problems")
