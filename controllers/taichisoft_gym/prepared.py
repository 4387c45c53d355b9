"""Models and the states in which their episodes begin, made once in a process."""

from functools import lru_cache

from taichisoft.model import Model
from taichisoft.scenes.file import scene_from_toml
from taichisoft.state import State

KEPT = 8


@lru_cache(maxsize=KEPT)
def prepared(scene: str, settling_time: float) -> tuple[Model, State]:
    """The model of a scene, as TOML, and its state after a time [s] in which nothing is asked of it."""
    from taichisoft.building.simulation import Simulation

    simulation = Simulation(scene_from_toml(scene, "scene"))
    for _ in range(round(settling_time / simulation.model.scene.time.step)):
        simulation.step()
    return simulation.model, simulation.state
