"""Contact problems of FCLIB and Siconos are read as what they say."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.sparse import csc_matrix, csr_matrix

from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.friction_problems import read_local_problem

RANDOM = np.random.default_rng(3)
M = np.diag(RANDOM.uniform(1.0, 2.0, 9))
H = RANDOM.normal(size=(9, 6))
G = RANDOM.normal(size=(9, 2))
F, W_VECTOR, MU, B = RANDOM.normal(size=9), RANDOM.normal(size=6), np.array([0.3, 0.7]), RANDOM.normal(size=2)


def write_matrix(group: Any, matrix: np.ndarray, kind: str) -> None:
    """As FCLIB writes it: compressed columns or rows, or triplets."""
    rows, columns = np.nonzero(matrix)
    if kind == "triplets":
        nz, p, i, x = len(rows), columns, rows, matrix[rows, columns]
    else:
        packed = (csc_matrix if kind == "columns" else csr_matrix)(matrix)
        nz, p, i, x = (-1 if kind == "columns" else -2), packed.indptr, packed.indices, packed.data
    for name, value in {"m": matrix.shape[0], "n": matrix.shape[1], "nz": nz, "nzmax": len(x)}.items():
        group[name] = np.array([value], dtype=np.int32)
    group["p"], group["i"], group["x"] = p, i, x


@pytest.mark.parametrize("kind", ["columns", "rows", "triplets"])
@pytest.mark.parametrize("joints", [False, True])
def test_global_problem_becomes_local_one(tmp_path: Path, kind: str, joints: bool) -> None:
    """For any r the velocities u = W r + q are those of the equations of motion, solved as they stand."""
    import h5py

    with h5py.File(tmp_path / "problem.hdf5", "w") as file:
        group = file.create_group("fclib_global")
        group["spacedim"] = np.array([3], dtype=np.int32)
        for name, matrix in {"M": M, "H": H, **({"G": G} if joints else {})}.items():
            write_matrix(group.create_group(name), matrix, kind)
        for name, vector in {"f": F, "w": W_VECTOR, "mu": MU, **({"b": B} if joints else {})}.items():
            group[f"vectors/{name}"] = vector
    w, q, mu = read_local_problem(tmp_path / "problem.hdf5")
    impulse = RANDOM.normal(size=6)
    if joints:
        system = np.block([[M, -G], [G.T, np.zeros((2, 2))]])
        velocity = np.linalg.solve(system, np.concatenate([H @ impulse + F, -B]))[:9]
    else:
        velocity = np.linalg.solve(M, H @ impulse + F)
    np.testing.assert_allclose(w @ impulse + q, H.T @ velocity + W_VECTOR, rtol=1e-12)
    np.testing.assert_array_equal(mu, MU)


def test_dense_and_block_files_hold_same_problem(tmp_path: Path) -> None:
    w = H.T @ H
    tail = [*W_VECTOR, *MU]
    (tmp_path / "dense.dat").write_text(" ".join(map(repr, map(float, [3, 2, 0, 6, 6, *w.T.ravel(), *tail]))).replace(
        "3.0 2.0 0.0 6.0 6.0", "3\n2\n0\n6\n6\n"
    ))  # fmt: skip
    blocks = []
    for number, (i, j) in enumerate([(0, 0), (0, 1), (1, 0), (1, 1)]):
        values = w[3 * i : 3 * i + 3, 3 * j : 3 * j + 3].T.ravel()
        blocks += [f"{number}", *(f"{value:.17e}" for value in values)]
    head = [3, 2, 1, 6, 6, *(4, 2, 2), *(3, 6), *(3, 6), *(3, 4), *(0, 2, 4), *(0, 1, 0, 1)]
    (tmp_path / "blocks.dat").write_text("\n".join([*map(str, head), *blocks, *(f"{value:.17e}" for value in tail)]))
    for name in ("dense", "blocks"):
        read = read_local_problem(tmp_path / f"{name}.dat")
        for value, expected in zip(read, (w, W_VECTOR, MU), strict=True):
            np.testing.assert_allclose(value, expected, rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("name, text", [("short.dat", "3 1 0 3 3 1.0"), ("flat.dat", "2 1 0 2 2"), ("a.dat", "words")])
def test_file_without_problem_is_refused(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(BenchmarkError, match=rf"{name}: is not a contact problem: .+"):
        read_local_problem(tmp_path / name)
