"""Models and initial states of episodes, made once per process."""

from functools import lru_cache

from taichisoft.model import Model
from taichisoft.scenes import scene_from_toml
from taichisoft.state import State

KEPT = 8


@lru_cache(maxsize=KEPT)
def prepared(scene: str, settling_time: float) -> tuple[Model, State]:
    """Model of a scene in TOML, and its state after a settling time [s] without requests."""
    from taichisoft.building import Simulation

    simulation = Simulation(scene_from_toml(scene, "scene"))
    for _ in range(round(settling_time / simulation.model.scene.time.step)):
        simulation.step()
    return simulation.model, simulation.state
