"""Learning environments for gymnasium, registered on import.

`gymnasium.make("taichisoft_gym:taichisoft/Grasp-v0")` imports the package. See docs/environments.md.
"""

from typing import TYPE_CHECKING

import gymnasium
import lazy_loader

if TYPE_CHECKING:
    from taichisoft_gym.disturbances import Bias, Delayed, Noise, Quantised, Sampled
    from taichisoft_gym.sensors import Bending, Camera, ContactForces, Flows

__all__ = ["Bending", "Bias", "Camera", "ContactForces", "Delayed", "Flows", "Noise", "Quantised", "Sampled"]
__getattr__, *_ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "disturbances": ["Bias", "Delayed", "Noise", "Quantised", "Sampled"],
        "sensors": ["Bending", "Camera", "ContactForces", "Flows"],
    },
)
EPISODES = {"Grasp": 120, "Reach": 30, "Carry": 200}
"""Control steps after which an episode is truncated, by environment."""

for _name, _steps in EPISODES.items():
    if f"taichisoft/{_name}-v0" not in gymnasium.registry:
        gymnasium.register(
            f"taichisoft/{_name}-v0",
            entry_point=f"taichisoft_gym.{_name.lower()}:{_name}",
            vector_entry_point=f"taichisoft_gym.vector:{_name.lower()}",
            max_episode_steps=_steps,
        )
