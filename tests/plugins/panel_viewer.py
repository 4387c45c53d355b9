"""A viewer of a web page that presses its keys, moves its sliders and sees where the surfaces are."""

import time
from typing import Any

import numpy as np

from taichisoft_benchmarks.measures.web_viewer import HEADER, Viewer

PATIENCE = 30.0
"""Longest time until something appears on the page [s]; usually it does so at once."""


class PanelViewer(Viewer):
    """A viewer that knows the panel and the surfaces of the page.

    Attributes:
        elements: label, value and other properties of each element of the panel, by its identifier.
        commands: identifiers of hotkeys, by key ("arrowup").
        vertices: newest vertices of each surface in the page's unit, shape (vertex_count, 3), by name ("/finger1").
    """

    def __init__(self, url: str):
        self.elements: dict[str, dict[str, Any]] = {}
        self.commands: dict[str, str] = {}
        self.vertices: dict[str, np.ndarray] = {}
        super().__init__(url)

    def find(self, label: str) -> str:
        """Identifier of the element with a label; waits until there is one."""
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            for identifier, element in list(self.elements.items()):
                if element.get("label") == label:
                    return identifier
            time.sleep(0.02)
        raise TimeoutError(f"the page has no '{label}'; it has {[e.get('label') for e in self.elements.values()]}")

    def set(self, label: str, value: Any) -> None:
        """Move the slider, press the button or fill in the field with a label."""
        self.send({"type": "GuiUpdateMessage", "uuid": self.find(label), "updates": {"value": value}})

    def press(self, key: str) -> None:
        """Press a hotkey ("arrowup")."""
        self.send({"type": "CommandTriggerMessage", "uuid": self.commands[key]})

    def value(self, label: str) -> Any:
        """Value of the element with a label."""
        return self.elements[self.find(label)]["value"]

    def take(self, content: dict[str, Any], packet: bytes) -> None:
        super().take(content, packet)
        starts, end = [], HEADER + int.from_bytes(packet[HEADER // 2 : HEADER], "little")
        for length in content["binaryBufferLengths"]:
            starts.append(end + (-end) % 8)
            end = starts[-1] + length

        def array(placeholder: dict[str, Any]) -> np.ndarray:
            index = placeholder["__binary_index"]
            length = content["binaryBufferLengths"][index]
            return np.frombuffer(packet[starts[index] : starts[index] + length], placeholder["dtype"]).reshape(-1, 3)

        for message in content["messages"]:
            kind = message["type"]
            if kind == "RegisterCommandMessage":
                self.commands[str(message["props"]["hotkey"]).lower()] = message["uuid"]
            elif kind == "GuiUpdateMessage":
                self.elements.setdefault(message["uuid"], {}).update(message["updates"])
            elif kind == "GuiRemoveMessage":
                self.elements.pop(message["uuid"], None)
            elif kind.startswith("Gui") and "props" in message:
                self.elements[message["uuid"]] = {"value": message.get("value"), **message["props"]}
            elif kind == "MeshMessage":
                self.vertices[message["name"]] = array(message["props"]["vertices"])
            elif kind == "SceneNodeUpdateMessage" and "vertices" in message["updates"]:
                self.vertices[message["name"]] = array(message["updates"]["vertices"])
