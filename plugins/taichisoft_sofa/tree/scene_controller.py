"""Controllers defined by a scene: components that receive events of keys and steps."""

import string
from abc import abstractmethod
from typing import Any

import numpy as np

from taichisoft_sofa.tree.component import Component
from taichisoft_sofa.tree.data import Data

# SOFA's characters of keys.

# The names of Sofa.constants.Key, and the characters passed to controllers.
KEYS = {
    "leftarrow": chr(18),
    "uparrow": chr(19),
    "rightarrow": chr(20),
    "downarrow": chr(21),
    "space": " ",
    "plus": "+",
    "minus": "-",
    "star": "*",
    "slash": "/",
    "equal": "=",
    **{letter: letter for letter in string.ascii_uppercase},
    **{f"KP_{digit}": digit for digit in string.digits},
}


def character(key: str) -> str | None:
    """The character passed to controllers for a key, given by name (`uparrow` or `up`) or as typed; None if unknown.

    Letters are passed as capitals, however they were typed. SOFA has no character for some keys.
    """
    for name in (key, f"{key}arrow"):
        if name in KEYS:
            return KEYS[name]
    return key.upper() if len(key) == 1 else None


# Method of the older generation for each event, and its arguments.
OLDER = {
    "KeypressedEvent": ("onKeyPressed", "key"),
    "KeyreleasedEvent": ("onKeyReleased", "key"),
    "AnimateBeginEvent": ("onBeginAnimationStep", "dt"),
    "AnimateEndEvent": ("onEndAnimationStep", "dt"),
}


class PythonComponent(Component):
    """A component of a class of the scene; attributes other than declared data are plain Python attributes."""

    def __new__(cls, *arguments: Any, **named: Any) -> "PythonComponent":
        made: Any = super().__new__(cls, *arguments, **named)
        made.set_all({"name": cls.__name__})
        return made

    def __init__(self, *_arguments: Any, **named: Any) -> None:
        self.set_all({name: value for name, value in named.items() if self.declared_data(name) is not None})

    def has_known_data(self) -> bool:
        """True: common data, and data added by the scene."""
        return True

    def takes_data(self, name: str, value: Any) -> bool:
        """True for existing data; other attributes are plain Python attributes."""
        is_value = isinstance(value, bool | int | float | str | list | tuple | np.ndarray | Data)
        return is_value and (name in self.data_by_name or self.declared_data(name) is not None)

    @abstractmethod
    def handle_event(self, event: str, content: dict[str, Any]) -> None:
        """Call the method for an event, if defined."""

    @abstractmethod
    def handles_event(self, event: str) -> bool:
        """Whether a method for an event is defined."""


class SceneController(PythonComponent):
    """A controller of SofaPython3, with methods such as onKeypressedEvent for a pressed key."""

    def handles_event(self, event: str) -> bool:
        return hasattr(type(self), f"on{event}") or hasattr(type(self), "onEvent")

    def handle_event(self, event: str, content: dict[str, Any]) -> None:
        method = getattr(self, f"on{event}", None)
        if not callable(method):
            method = getattr(self, "onEvent", None)
        if method is not None and self.findData("listening"):
            method({"type": event, **content})

    def scene_is_complete(self) -> None:
        """Initialise the controller of a complete scene, as SOFA does."""
        self.init()
        self.bwdInit()
        if self.handles_event("SimulationInitDoneEvent"):
            self.handle_event("SimulationInitDoneEvent", {})

    def bwdInit(self) -> None:
        """Do nothing; classes of scenes override this, with all other components initialised."""


# Scenes know the class as Sofa.Core.Controller, and an object of it has this type and name.
SceneController.__name__ = "Controller"


class PythonScriptController(PythonComponent):
    """A controller of SofaPython, the older generation, which receives its node."""

    def __new__(cls, context: Any = None, *arguments: Any, **named: Any) -> "PythonScriptController":
        # Classes of scenes define __init__ without calling ours.
        made: Any = super().__new__(cls, context, *arguments, **named)
        made.type_name = "PythonScriptController"
        made.set_all({"name": made.type_name})
        if context is not None:
            context.addObject(made)
        return made

    def handles_event(self, event: str) -> bool:
        return event in OLDER and hasattr(type(self), OLDER[event][0])

    def handle_event(self, event: str, content: dict[str, Any]) -> None:
        if self.handles_event(event):
            method, argument = OLDER[event]
            getattr(self, method)(content[argument])

    def scene_is_complete(self) -> None:
        for method in ("createGraph", "initGraph", "bwdInitGraph"):
            if hasattr(type(self), method):
                getattr(self, method)(self._context)


# Classes from which a scene derives force fields and engines of its own, which are refused by name.


class OwnComponent(SceneController):
    """A component whose computation is a program of the scene.

    Attributes:
        refusal: why it is refused, and a way out.
    """

    refusal = ""


class ForceField(OwnComponent):
    """A force field of the scene's own."""

    refusal = (
        "is a force field of the scene's own, whose stiffness the solver here does not take; forces that are known "
        "come from ConstantForceField, springs from RestShapeSpringsForceField, other laws from a native scene"
    )


class DataEngine(OwnComponent):
    """An engine of the scene's own."""

    refusal = (
        "is an engine of the scene's own; compute its data in createScene, or in every step by a Sofa.Core.Controller"
    )
