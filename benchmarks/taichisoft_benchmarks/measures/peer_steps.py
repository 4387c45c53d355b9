"""Time per step of another program on the bodies and pressures of a scene."""

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import count
from typing import TYPE_CHECKING, Protocol

import numpy as np

from taichisoft import Scene
from taichisoft_benchmarks.cases import PeerCase
from taichisoft_benchmarks.measures.measured import Measured, peak_memory
from taichisoft_benchmarks.measures.steps import window_medians

if TYPE_CHECKING:
    from taichisoft.contact import Model


class Peer(Protocol):
    """Another program, set up with a model of ours; node arrays are in the order of the model's soft nodes."""

    does_not: str
    """Parts of the job that the program leaves out."""

    def positions(self) -> np.ndarray:
        """Positions of the nodes [mm], shape (node_count, 3)."""

    def step(self, force: np.ndarray) -> None:
        """One time step of the scene with these forces on the nodes [mN], shape (node_count, 3)."""

    def facts(self) -> dict[str, int]:
        """Properties of the run at its end."""


def measure_peer(case: PeerCase, scene: Scene) -> Measured:
    """Make the case's steps under the pressures of the scene's script.

    Raises:
        PeerMissing: the program is not installed, or cannot do the case.
    """
    started = time.perf_counter()
    model, peer = set_up_peer(scene, case.peer)
    prepared = time.perf_counter() - started
    step = controlled_peer_step(scene, model, peer)
    seconds = [step() for _ in range(min(case.steps, case.peer_steps or case.steps))]
    figures = {**window_medians(case, seconds), "prepare_s": prepared, "peak_mb": peak_memory()}
    moved = np.linalg.norm(peer.positions() - model.rest_position, axis=1).max()
    facts = {"nodes": model.node_count, "displacement_mm": round(float(moved), 4), **peer.facts()}
    return Measured(figures, facts, does_not=peer.does_not)


def set_up_peer(scene: Scene, name: str) -> tuple["Model", Peer]:
    """The model of a scene, and another program set up with it.

    Raises:
        PeerMissing: the program is not installed, or cannot do the scene.
    """
    from taichisoft.running import make_model

    model = make_model(scene)
    return model, _factory(name)(model)


def controlled_peer_step(scene: Scene, model: "Model", peer: Peer) -> Callable[[], float]:
    """A function that makes one step under the pressures of the scene's script and returns its time [s].

    The pressure acts as forces on the nodes; the time to compute these is not counted.
    """
    from taichisoft.running import Simulation, make_controller

    observation = Simulation(model).observe()  # at the start: the scripts look at the time only
    controller = make_controller(scene)
    controller.reset(model)
    numbers = count()

    def step() -> float:
        number = next(numbers)
        control = controller.control(replace(observation, step=number, time=number * scene.time.step))
        force = pressure_forces(model, peer.positions(), control.pressure)
        begun = time.perf_counter()
        peer.step(force)
        return time.perf_counter() - begun

    return step


def pressure_forces(model: "Model", position: np.ndarray, pressure: Mapping[str, float]) -> np.ndarray:
    """Forces of the air on the nodes [mN], shape (node_count, 3).

    Args:
        model: model with the walls of the cavities.
        position: positions of the nodes [mm], shape (node_count, 3).
        pressure: pressure [kPa] by cavity name.
    """
    from taichisoft.mechanics import ActuatorGeometry

    actuators, start = model.actuators, model.initial_state()
    geometry = ActuatorGeometry(actuators, model.node_count)
    geometry.update(start.changed(position=position.copy()), model.placed_pull_points(start))
    loss = np.zeros(actuators.count - len(actuators.names))
    effort = actuators.joined(np.array([pressure.get(name, 0.0) for name in actuators.names]), loss)
    by_entry = np.repeat(effort, np.diff(actuators.coordinates.entry_start))
    force = np.zeros((model.node_count, 3))
    np.add.at(force, actuators.coordinates.entry_node, by_entry[:, None] * geometry.gradient.soft)
    return force


def _factory(name: str) -> Callable[..., Peer]:
    if name == "drake":
        from taichisoft_benchmarks.peers.drake_deformable import DrakePeer

        return DrakePeer
    from taichisoft_benchmarks.peers.mujoco_flex import MujocoPeer

    if name == "mujoco":
        return MujocoPeer
    return lambda model: MujocoPeer(model, iterations=1000, tolerance=1e-12)
