"""Other programs are given our finger: it hangs as far as ours does, and who is absent says so."""

import sys

import numpy as np
import pytest

from taichisoft import Control, Simulation, load_scene, make_model
from taichisoft_benchmarks.errors import PeerMissing
from taichisoft_benchmarks.measures.peer_steps import pressure_forces
from taichisoft_benchmarks.peers.drake_deformable import DrakePeer
from taichisoft_benchmarks.peers.mujoco_flex import MujocoPeer

STEPS = 30


def test_who_is_not_installed_says_what_to_install(monkeypatch):
    model = make_model(load_scene("finger-hanging"))
    for package, peer in (("mujoco", MujocoPeer), ("pydrake.multibody.plant", DrakePeer)):
        monkeypatch.setitem(sys.modules, package, None)
        with pytest.raises(PeerMissing, match=r"is not installed; pip install 'taichisoft\[peers\]'"):
            peer(model)


@pytest.mark.parametrize(("package", "peer"), [("mujoco", MujocoPeer), ("pydrake", DrakePeer)])
def test_the_finger_hangs_as_ours_does(package, peer, tmp_path, monkeypatch):
    """Other element laws and mass lumping: a third of the way, to see that units, clamping and gravity are right."""
    pytest.importorskip(package)
    monkeypatch.chdir(tmp_path)  # MuJoCo leaves a log
    simulation = Simulation(load_scene("finger-hanging"))
    other = peer(simulation.model)
    rest = simulation.model.rest_position
    assert np.allclose(other.positions(), rest, atol=1e-6)
    for _ in range(STEPS):
        simulation.step()
        other.step(np.zeros_like(rest))
    ours = np.abs(simulation.state.position - rest).max()
    theirs = np.abs(other.positions() - rest).max()
    assert theirs == pytest.approx(ours, rel=1 / 3)


def test_mujoco_gets_the_whole_of_quadratic_elements(tmp_path, monkeypatch):
    """Eight linear parts each, which hang as far but for their own stiffness, when its solver may take its time."""
    pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)
    simulation = Simulation(load_scene("finger-hanging", ["soft_bodies.finger.element=quadratic"]))
    other, rest = MujocoPeer(simulation.model, iterations=1000), simulation.model.rest_position
    for _ in range(10):
        simulation.step()
        other.step(np.zeros_like(rest))
    ours = np.abs(simulation.state.position - rest).max()
    assert np.abs(other.positions() - rest).max() == pytest.approx(ours, rel=1 / 3)


def test_a_motion_that_becomes_unstable_is_no_comparison(tmp_path, monkeypatch):
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


def test_mujocos_finger_has_a_stiff_layer_of_the_same_effect(tmp_path, monkeypatch):
    """A layer of ten times its stiffness changes how far the finger bends by the same factor in both."""
    pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)
    stiffer = ["soft_bodies.finger.regions.0.young_modulus=15000.0"]
    theirs = bend(stiffer, True) / bend([], True)
    ours = bend(stiffer, False) / bend([], False)
    assert abs(ours - 1.0) > 0.1
    assert theirs == pytest.approx(ours, rel=0.1)
