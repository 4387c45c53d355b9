"""Learning environments for gymnasium; importing the package registers them.

`gymnasium.make("taichisoft_gym:taichisoft/Grasp-v0")` imports it by itself. docs/environments.md describes them.
"""

import gymnasium

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
