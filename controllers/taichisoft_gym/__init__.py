"""Learning environments for gymnasium, registered on import.

`gymnasium.make("taichisoft_gym:taichisoft/Grasp-v0")` imports the package. See docs/environments.md.
"""

from typing import TYPE_CHECKING

import lazy_loader

from taichisoft.base import extra, require

if TYPE_CHECKING:
    from taichisoft_gym.actuation import ArmTravel, Travel
    from taichisoft_gym.channels import Channel, ChannelGroup
    from taichisoft_gym.environment import SoftRobotEnvironment
    from taichisoft_gym.vector import SoftRobotVectorEnv
    from taichisoft_gym.wrappers import Camera, Disturbed, Observed

__all__ = [
    "ArmTravel",
    "Camera",
    "Channel",
    "ChannelGroup",
    "Disturbed",
    "Observed",
    "SoftRobotEnvironment",
    "SoftRobotVectorEnv",
    "Travel",
]
__getattr__, *_ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "actuation": ["ArmTravel", "Travel"],
        "channels": ["Channel", "ChannelGroup"],
        "environment": ["SoftRobotEnvironment"],
        "vector": ["SoftRobotVectorEnv"],
        "wrappers": ["Camera", "Disturbed", "Observed"],
    },
)
EPISODES = {"Grasp": 120, "Reach": 30, "Carry": 200}
"""Control steps after which an episode is truncated, by environment."""


def _register() -> None:
    import gymnasium  # which may be missing

    for name, steps in EPISODES.items():
        if f"taichisoft/{name}-v0" not in gymnasium.registry:
            gymnasium.register(
                f"taichisoft/{name}-v0",
                entry_point=f"taichisoft_gym.tasks:{name}",
                vector_entry_point=f"taichisoft_gym.vector:{name.lower()}",
                max_episode_steps=steps,
            )


require("taichisoft_gym", "gymnasium", install=extra("gym"))
_register()
