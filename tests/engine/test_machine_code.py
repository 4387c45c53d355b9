"""Machine code of kernels: kept for the next process, made anew where it is damaged, with the same bits everywhere."""

import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from conftest import PATIENCE

import taichisoft
from taichisoft.base.kept_files import keep, read_kept
from taichisoft.errors import TaichisoftError
from taichisoft.runtime import kernel, machine_code, ti
from taichisoft.runtime.language import Scalars, func
from taichisoft.runtime.launch import Kernel

pytestmark = pytest.mark.skipif(not machine_code.is_supported(), reason="no machine code is kept on this system")

PROGRAM = """
import sys
import numpy as np
from taichisoft.runtime.launch import kernel
from taichisoft.runtime.language import Scalars
@kernel
def fill(values: Scalars):
    for i in values:
        values[i] = 0.5 * i
values = np.zeros(2000)
fill(values)
assert (values == 0.5 * np.arange(2000)).all()
print("compiled" if "taichi" in sys.modules else "kept")
"""


def start(folder: Path, code: str = PROGRAM, **environment: str) -> subprocess.Popen[str]:
    """Start a program with a kernel, whose machine code is kept in a folder."""
    (folder / "program.py").write_text(code)
    given = {**os.environ, "XDG_CACHE_HOME": str(folder), **environment}
    pipe = subprocess.PIPE
    return subprocess.Popen([sys.executable, folder / "program.py"], env=given, stdout=pipe, stderr=pipe, text=True)


def kept_files(folder: Path) -> list[Path]:
    return sorted((folder / "taichisoft/kernels").glob("fill-*"))


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which two processes at once have kept the machine code."""
    folder = tmp_path_factory.mktemp("compiled")
    printed = [process.communicate(timeout=PATIENCE) for process in [start(folder) for _ in range(2)]]
    assert {errors for _, errors in printed} == {""}
    assert {output for output, _ in printed} <= {"compiled\n", "kept\n"}
    return folder


def test_processes_at_once_leave_one_file_for_all(compiled: Path) -> None:
    assert [path.suffix for path in kept_files(compiled)] == [".kernel"]  # no lock and no partial file
    assert start(compiled).communicate(timeout=PATIENCE) == ("kept\n", "")


def test_damaged_file_is_made_anew(compiled: Path, tmp_path: Path) -> None:
    shutil.copytree(compiled, tmp_path, dirs_exist_ok=True)
    (path,) = kept_files(tmp_path)
    data = path.read_bytes()
    path.write_bytes(data[:-9])
    told = f"taichisoft: {path} is damaged and is made anew\n"
    assert start(tmp_path).communicate(timeout=PATIENCE) == ("compiled\n", told)
    assert start(tmp_path).communicate(timeout=PATIENCE) == ("kept\n", "")


@pytest.mark.parametrize("damage", ["flipped", "cut", "empty", "foreign"])
def test_damage_of_a_kept_file_is_seen(damage: str, tmp_path: Path) -> None:
    path = tmp_path / "kept"
    keep(path, bytes(range(200)))
    assert read_kept(path) == bytes(range(200))
    data = bytearray(path.read_bytes())
    data[-100] ^= 1
    path.write_bytes({"flipped": bytes(data), "cut": data[:-9], "empty": b"", "foreign": b"\x7fELF of another"}[damage])
    assert read_kept(path) is None


def test_kernels_of_the_package_are_taken_first(compiled: Path, tmp_path: Path) -> None:
    shipped = shutil.copytree(compiled / "taichisoft/kernels", tmp_path / "shipped")
    setting = "from pathlib import Path\nfrom taichisoft.runtime import machine_code\n"
    code = f"{setting}machine_code.SHIPPED = Path({str(shipped)!r})\n{PROGRAM}"
    assert start(tmp_path, code).communicate(timeout=PATIENCE) == ("kept\n", "")
    assert list((tmp_path / "taichisoft/kernels").iterdir()) == []


def test_folder_that_cannot_be_written_costs_only_time(tmp_path: Path) -> None:
    (tmp_path / "taichisoft").mkdir()
    (tmp_path / "taichisoft/kernels").touch()
    output, errors = start(tmp_path).communicate(timeout=PATIENCE)
    assert output == "compiled\n"
    assert f"nothing can be kept in {tmp_path / 'taichisoft/kernels'} (Not a directory)" in errors


def test_taichi_runs_kernels_where_it_is_asked_to(tmp_path: Path) -> None:
    assert start(tmp_path, TAICHISOFT_KERNELS="taichi").communicate(timeout=PATIENCE) == ("compiled\n", "")
    assert kept_files(tmp_path) == []
    _, errors = start(tmp_path, TAICHISOFT_KERNELS="c").communicate(timeout=PATIENCE)
    assert "TAICHISOFT_KERNELS = 'c': must be machine-code or taichi" in errors


def test_warm_start_imports_nothing_slow() -> None:
    """What takes long to import is imported to compile, to read a surface anew, or not at all."""
    taichisoft.Simulation(taichisoft.load_scene("gripper")).step()  # keeps what the next process finds
    code = (
        "import sys, taichisoft\n"
        "taichisoft.Simulation(taichisoft.load_scene('gripper')).step()\n"
        "print(*{'taichi', 'trimesh', 'networkx', 'scipy.spatial', 'scipy.optimize', 'meshio'} & sys.modules.keys())"
    )
    command = [sys.executable, "-W", "ignore", "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
    assert (done.stdout, done.stderr) == ("\n", "")


def scaled(factor: float, power: int) -> Kernel:
    @func
    def raised(x: ti.f64) -> ti.f64:
        return x**power

    @kernel
    def scale(values: Scalars):
        for i in values:
            values[i] = factor * raised(values[i])

    return scale


def test_key_differs_with_all_that_a_kernel_refers_to(monkeypatch: pytest.MonkeyPatch) -> None:
    names = [machine_code.kept_name(scaled(*constants)) for constants in [(2.0, 2), (2.0, 2), (3.0, 2), (2.0, 3)]]
    assert names[0] == names[1]
    assert len(set(names)) == 3
    monkeypatch.setattr(machine_code, "target", lambda: ("haswell", ""))
    assert machine_code.kept_name(scaled(2.0, 2)) != names[0]


def test_kernels_of_one_source_use_their_own_constants() -> None:
    results = []
    for constants in [(2.0, 2), (3.0, 2), (2.0, 3)]:
        values = np.array([1.0, 2.0])
        scaled(*constants)(values)
        results.append(values.tolist())
    assert results == [[2.0, 8.0], [3.0, 12.0], [2.0, 16.0]]


def test_kernel_that_prints_is_refused() -> None:
    @kernel
    def show(values: Scalars):
        for i in values:
            print(values[i])

    with pytest.raises(TaichisoftError, match=r"^kernel show: it asserts, prints .* TAICHISOFT_KERNELS=taichi runs it"):
        show(np.zeros(3))


@kernel
def add_products(x: Scalars, y: Scalars, result: Scalars):
    """Long chains of sums, sums that LLVM vectorises, products that it fuses with sums, and functions of libm."""
    ti.loop_config(serialize=True)
    for i in range(result.shape[0]):
        total, product = 0.0, 1.0
        for k in range(x.shape[0]):
            total += x[k] * y[(k + i) % y.shape[0]]
        for k in range(x.shape[0]):
            product = product * (1.0 + 1e-3 * x[k]) + y[k]
        vector = ti.Vector([x[(i + c) % x.shape[0]] for c in range(8)])
        chain, longer = x[i] / y[i], 1.0
        for k in ti.static(range(12)):
            chain += x[i + k] / y[i + k] + x[i + k]
            longer *= 1.0 + 0.1 * y[i + k] * x[i + 2 * k] * chain
        square = (vector * vector).sum() / vector.norm()
        result[i] = chain * longer + total + ti.sqrt(ti.abs(product)) + ti.sin(total) + square


def test_every_processor_gives_the_same_bits(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    llvm = machine_code._llvm()
    host = llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()
    x, y = np.random.default_rng(0).normal(size=(2, 1000))
    monkeypatch.setattr(machine_code, "kept_folder", lambda kind: tmp_path)
    results = []
    for target in [("x86-64-v3", ""), host, ("haswell", "")]:
        monkeypatch.setattr(machine_code, "target", lambda target=target: target)
        result = np.zeros(40)
        Kernel(add_products.function)(x, y, result)
        results.append(result.tobytes())
    assert len(list(tmp_path.glob("add_products*"))) == 3
    assert results[0] == results[1] == results[2]


def test_simulations_in_threads_have_the_bits_of_one_alone() -> None:
    scene = taichisoft.load_scene("finger-inflated")

    def inflate(pressure: float, states: dict[float, bytes]) -> None:
        simulation = taichisoft.Simulation(scene)
        for _ in range(20):
            simulation.step(taichisoft.Control(pressure={"finger.cavity": pressure}))
        states[pressure] = simulation.state.position.tobytes()

    alone: dict[float, bytes] = {}
    together: dict[float, bytes] = {}
    pressures = [5.0, 10.0, 15.0, 20.0]
    for pressure in pressures:
        inflate(pressure, alone)
    threads = [threading.Thread(target=inflate, args=(pressure, together)) for pressure in pressures]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert together == alone
