"""What a controller remembers, as JSON: outputs keep it, and a run that goes on from there gives it back."""

import json
from typing import Any

from taichisoft.control.controller import Controller
from taichisoft.errors import PluginError
from taichisoft.plugin_system.failure import failures_of

PLAIN = (str, int, float, type(None))  # True and False are integers


def saved_as_json(controller: Controller) -> str:
    """What a controller remembers now, as JSON that gives the same bits back; empty where it does not save.

    Raises:
        PluginError: its `save` failed, or returned what JSON cannot hold.
    """
    name = f"controller {type(controller).__module__}.{type(controller).__qualname__}"
    with failures_of(f"{name} failed in save()"):
        saved = controller.save()
    if saved is None:
        return ""
    if not isinstance(saved, dict):
        raise PluginError(f"{name}: save() returned {_shown(saved)}; must be a dict, or None")
    _check(saved, "", name)
    return json.dumps(saved)


def _check(value: Any, key: str, name: str) -> None:
    """Refuse what JSON cannot hold, or gives back as something else."""
    if isinstance(value, dict):
        for inner, content in value.items():
            if not isinstance(inner, str):
                raise PluginError(f"{name}: save(): {key or 'a key'}: key {_shown(inner)} must be a text")
            _check(content, f"{key}.{inner}".strip("."), name)
    elif isinstance(value, list | tuple):
        for number, content in enumerate(value):
            _check(content, f"{key}.{number}", name)
    elif not isinstance(value, PLAIN):
        raise PluginError(f"{name}: save(): {key} = {_shown(value)}: {_advice(value)}")


def _advice(value: Any) -> str:
    """What to save instead of a value that JSON cannot hold."""
    if hasattr(value, "bit_generator"):
        return "save its `bit_generator.state`"
    return "save its `tolist()`" if hasattr(value, "tolist") else "must be a number, a text, a list, or a dict of these"


def _shown(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."
