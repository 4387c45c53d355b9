"""The names that an expression about a step may use: what a controller sees, with pairs of bodies as one name."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from taichisoft.control.observation import Observation


def observed_values(observation: Observation) -> dict[str, Any]:
    """The observation's attributes by name; `normal_forces["finger|cube"]` is that of a pair."""
    values = {one.name: getattr(observation, one.name) for one in fields(observation) if one.name != "state"}
    return {name: _named_pairs(value) for name, value in values.items()}


def _named_pairs(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {"|".join(key) if isinstance(key, tuple) else key: one for key, one in value.items()}
    return value
