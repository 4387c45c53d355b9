"""Controllers that a scene defines: objects of its own that are told of keys and steps."""

from abc import abstractmethod
from typing import Any

import numpy as np

from taichisoft_sofa.tree.component import Component
from taichisoft_sofa.tree.data import Data

# What the older generation calls an event, and what its method is given of it.
OLDER = {
    "KeypressedEvent": ("onKeyPressed", "key"),
    "KeyreleasedEvent": ("onKeyReleased", "key"),
    "AnimateBeginEvent": ("onBeginAnimationStep", "dt"),
    "AnimateEndEvent": ("onEndAnimationStep", "dt"),
}


class PythonComponent(Component):
    """A component of a class that a scene defines; its attributes are its own, but for those that are declared data."""

    def __new__(cls, *arguments: Any, **named: Any) -> "PythonComponent":
        made: Any = super().__new__(cls, *arguments, **named)
        made.set_all({"name": cls.__name__})
        return made

    def __init__(self, *_arguments: Any, **named: Any) -> None:
        self.set_all({name: value for name, value in named.items() if self.declared_data(name) is not None})

    def has_known_data(self) -> bool:
        """Always: those of all components, and those that it adds."""
        return True

    def takes_data(self, name: str, value: Any) -> bool:
        """Only to data that it has: other attributes are the class's own."""
        is_value = isinstance(value, bool | int | float | str | list | tuple | np.ndarray | Data)
        return is_value and (name in self.data_by_name or self.declared_data(name) is not None)

    @abstractmethod
    def handle_event(self, event: str, content: dict[str, Any]) -> None:
        """Tell it of an event, if it has a method for that."""

    @abstractmethod
    def handles_event(self, event: str) -> bool:
        """Whether it has a method for an event."""


class Controller(PythonComponent):
    """A controller for SofaPython3: its method for a key that is pressed is onKeypressedEvent, and so on."""

    def handles_event(self, event: str) -> bool:
        """Whether it has a method for an event."""
        return hasattr(type(self), f"on{event}") or hasattr(type(self), "onEvent")

    def handle_event(self, event: str, content: dict[str, Any]) -> None:
        """Tell it of an event, if it has a method for that."""
        method = getattr(self, f"on{event}", None)
        if not callable(method):
            method = getattr(self, "onEvent", None)
        if method is not None and self.findData("listening"):
            method({"type": event, **content})

    def scene_is_complete(self) -> None:
        """What SOFA does once the scene is complete."""
        self.init()
        self.bwdInit()
        if self.handles_event("SimulationInitDoneEvent"):
            self.handle_event("SimulationInitDoneEvent", {})

    def bwdInit(self) -> None:
        """Nothing; scenes' own classes may do what needs all others to be ready."""


class PythonScriptController(PythonComponent):
    """A controller for SofaPython, the older generation, which is given the node that it is for."""

    def __new__(cls, context: Any = None, *arguments: Any, **named: Any) -> "PythonScriptController":
        # Classes of scenes define __init__ without calling ours.
        made: Any = super().__new__(cls, context, *arguments, **named)
        made.type_name = "PythonScriptController"
        made.set_all({"name": made.type_name})
        if context is not None:
            context.addObject(made)
        return made

    def handles_event(self, event: str) -> bool:
        """Whether it has a method for an event."""
        return event in OLDER and hasattr(type(self), OLDER[event][0])

    def handle_event(self, event: str, content: dict[str, Any]) -> None:
        """Tell it of an event, if it has a method for that."""
        if self.handles_event(event):
            method, argument = OLDER[event]
            getattr(self, method)(content[argument])

    def scene_is_complete(self) -> None:
        """What SOFA does once the scene is complete."""
        for method in ("createGraph", "initGraph", "bwdInitGraph"):
            if hasattr(type(self), method):
                getattr(self, method)(self._context)
