"""How cases are measured: factorisations, outputs, plug-ins, several processes, other programs."""

import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sparse

from taichisoft import Control, Scene, Simulation, load_scene, make_model
from taichisoft.mechanics.cholesky import Cholesky, SymbolicFactor
from taichisoft.scene.scene import SceneControllerSettings
from taichisoft_benchmarks import measures
from taichisoft_benchmarks.cases import RecordingCase
from taichisoft_benchmarks.errors import PeerMissing
from taichisoft_benchmarks.peers import MujocoPeer, prepare_cholmod, prepare_superlu, pressure_forces

STEPS = 30


def chain(node_count: int) -> tuple[sparse.csc_matrix, np.ndarray]:
    """Random blocks of a chain of nodes as the whole matrix of other libraries, and as a dense one."""
    pattern = sparse.diags([1.0, 1.0, 1.0], [-1, 0, 1], (node_count, node_count)).tocsr()
    solver = Cholesky(SymbolicFactor(pattern))
    random = np.random.default_rng(0)
    dense = np.zeros((3 * node_count, 3 * node_count))
    for block, (row, column) in zip(solver.blocks, solver.symbolic.block_pairs, strict=True):
        block[:] = random.normal(size=(3, 3))
        if row == column:
            block[:] = block + block.T + 20.0 * np.eye(3)
        dense[3 * row : 3 * row + 3, 3 * column : 3 * column + 3] = block
        dense[3 * column : 3 * column + 3, 3 * row : 3 * row + 3] = block.T
    return measures.system_matrix(solver.symbolic.block_pairs, solver.blocks, node_count), dense


def test_superlu_factorises_whole_matrix():
    matrix, dense = chain(5)
    assert np.array_equal(matrix.toarray(), dense)
    assert np.allclose(prepare_superlu(matrix)().solve(dense @ np.arange(15.0)), np.arange(15.0))


def test_cholmod_factorises_it():
    cvxopt = pytest.importorskip("cvxopt")
    matrix, dense = chain(5)
    x = cvxopt.matrix(dense @ np.arange(15.0))
    cvxopt.cholmod.solve(prepare_cholmod(matrix)(), x)
    assert np.allclose(np.array(x).ravel(), np.arange(15.0))


def test_full_matrix_takes_third_of_its_cube():
    full = sparse.csc_matrix(np.tril(np.ones((30, 30))))
    assert measures.arithmetic(full) == pytest.approx(30 * 31 * 61 / 6 / 1e6)


def test_cost_of_recording_is_median_of_pairs(taichisoft_scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    seconds = iter([0.0, 1.0, 1.5, 3.0, 2.0, 9.0, 9.1])  # of a first run and of three pairs, the second turned round
    starts = []

    def run(simulation: Simulation, scene: Scene, steps: int, folder: Path | None) -> tuple[float, float]:
        starts.append(simulation.state.position)
        if folder is not None:
            (folder / "recording.h5").write_bytes(bytes(40_000))
        return next(seconds), 0.02

    monkeypatch.setattr(measures, "_recorded_run", run)
    case = RecordingCase(kind="recording", title="", scene="", finger="", steps=10, pairs=3)
    figures = measures.measure_recording(case, taichisoft_scene).figures
    assert figures["cost_ms"] == pytest.approx(1e3 * 0.5 / 10)  # 0.5, 1.0 and 0.1 s
    assert figures["cost_percent"] == pytest.approx(100.0 * 0.5 / 2.0)
    assert figures["output_ms"] == pytest.approx(1e3 * 0.02 / 10)
    assert figures["kb_per_step"] == 4.0
    assert all(np.array_equal(start, starts[0]) for start in starts)


def test_recording_is_written_and_measured(taichisoft_scene: Scene) -> None:
    case = RecordingCase(kind="recording", title="", scene="", finger="", steps=4, pairs=1)
    scene = taichisoft_scene.model_copy(update={"controller": SceneControllerSettings(name="keyboard")})
    figures = measures.measure_recording(case, scene).figures
    assert min(figures["step_ms"], figures["output_ms"]) > 0.0 and figures["kb_per_step"] > 1.0


def test_missing_peer_says_what_to_install(monkeypatch):
    model = make_model(load_scene("finger-hanging"))
    for package, peer, subject in (
        ("mujoco", MujocoPeer, model),
        ("cvxopt", prepare_cholmod, sparse.identity(3).tocsc()),
    ):
        monkeypatch.setitem(sys.modules, package, None)
        with pytest.raises(PeerMissing, match=r"is not installed; pip install 'taichisoft\[peers\]'"):
            peer(subject)


@pytest.mark.parametrize(
    ("package", "peer", "overrides", "steps"),
    [
        ("mujoco", MujocoPeer, [], STEPS),
        # Eight linear parts each, which hang as far but for their own stiffness, when its solver may take its time.
        ("mujoco", lambda model: MujocoPeer(model, 1000), ["soft_bodies.finger.element=quadratic"], 10),
    ],
)
def test_finger_hangs_in_peers_as_here(package, peer, overrides, steps, tmp_path, monkeypatch):
    """Other element laws and mass lumping: within a third, to see that units, clamping and gravity are right."""
    pytest.importorskip(package)
    monkeypatch.chdir(tmp_path)  # MuJoCo leaves a log
    simulation = Simulation(load_scene("finger-hanging", overrides))
    other, rest = peer(simulation.model), simulation.model.rest_position
    assert np.allclose(other.positions(), rest, atol=1e-6)
    for _ in range(steps):
        simulation.step()
        other.step(np.zeros_like(rest))
    ours = np.abs(simulation.state.position - rest).max()
    assert np.abs(other.positions() - rest).max() == pytest.approx(ours, rel=1 / 3)


def test_unstable_motion_of_mujoco_is_refused(tmp_path, monkeypatch):
    pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)
    model = make_model(load_scene("finger-hanging"))
    other = MujocoPeer(model)
    with pytest.raises(PeerMissing, match="became unstable"):
        for _ in range(STEPS):
            other.step(np.full_like(model.rest_position, 1e30))


def bend(scene_overrides: list[str], in_mujoco: bool) -> float:
    """Largest displacement of the inflated finger [mm]."""
    model = make_model(load_scene("finger-inflated", scene_overrides))
    simulation, other = Simulation(model), MujocoPeer(model)
    for step in range(STEPS):
        pressure = {"finger.cavity": float(step)}
        simulation.step(Control(pressure=pressure))
        other.step(pressure_forces(model, other.positions(), pressure))
    position = other.positions() if in_mujoco else simulation.state.position
    return float(np.abs(position - model.rest_position).max())


def test_stiff_layer_has_same_effect_in_mujoco(tmp_path, monkeypatch):
    """A layer of ten times its stiffness changes how far the finger bends by the same factor in both."""
    pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)
    stiffer = ["soft_bodies.finger.regions.0.young_modulus=15000.0"]
    theirs, ours = (bend(stiffer, in_mujoco) / bend([], in_mujoco) for in_mujoco in (True, False))
    assert abs(ours - 1.0) > 0.1
    assert theirs == pytest.approx(ours, rel=0.1)
