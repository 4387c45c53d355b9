"""A viewer of a web page that presses its keys, moves its sliders and sees where the surfaces are."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import conftest
import numpy as np

from taichisoft_benchmarks.output_costs import HEADER, Viewer

PATIENCE = 30.0
"""Longest time until something appears on the page [s]; usually it does so at once."""


class PanelViewer(Viewer):
    """A viewer that knows the panel and the surfaces of the page.

    Attributes:
        elements: label, value and other properties of each element of the panel, by its identifier.
        commands: identifiers of hotkeys, by key ("arrowup").
        vertices: newest vertices of each surface, and ends of lines, in the page's unit, shape (vertex_count, 3), by
            name ("/finger1").
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
            elif kind == "LineSegmentsMessage":
                self.vertices[message["name"]] = array(message["props"]["points"])
            elif kind == "SceneNodeUpdateMessage" and "points" in message["updates"]:
                self.vertices[message["name"]] = array(message["updates"]["points"])
            elif kind == "SceneNodeUpdateMessage" and "vertices" in message["updates"]:
                self.vertices[message["name"]] = array(message["updates"]["vertices"])


@contextmanager
def served(path: Path) -> Iterator[tuple[Any, PanelViewer, Callable[[Callable[[], bool]], None]]]:
    """The page of a recording, a viewer of it, and what lets the page go on until a condition holds."""
    from taichisoft_outputs.web.address import find_address
    from taichisoft_outputs.web.recording_page import RecordingPage

    address = find_address("127.0.0.1:0")
    page = RecordingPage(path, address)

    def until(condition: Callable[[], bool]) -> None:
        deadline = time.monotonic() + conftest.PATIENCE
        while not condition():
            assert time.monotonic() < deadline, "waited in vain"
            page.tick(0.02)
            time.sleep(0.02)

    try:
        with PanelViewer(address.at(page.page.port).url) as viewer:
            yield page, viewer, until
    finally:
        page.close()
