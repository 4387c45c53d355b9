"""A viewer of a web page that presses its keys, moves its sliders and sees where the surfaces are."""

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

import conftest
import msgspec
import numpy as np
import zstandard
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

PATIENCE = 30.0
"""Longest time until something appears on the page [s]; usually it does so at once."""


HEADER = 16
"""Bytes of a packet before its messages: two lengths."""
CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [0.0, 0.0, 5.0],
    "fov": 0.5,
    "near": 0.01,
    "far": 1000.0,
    "image_height": 600,
    "image_width": 800,
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 0.0, 1.0],
}


class PanelViewer:
    """Reads a page in a thread, as a browser does that has loaded it; use it in a `with` statement.

    Attributes:
        elements: label, value and other properties of each element of the panel, by its identifier.
        commands: identifiers of hotkeys, by key ("arrowup").
        vertices: newest vertices of each surface, and ends of lines, in the page's unit, shape (vertex_count, 3), by
            name ("/finger1").
        moments: when each surface of the scene has moved, on the clock of `time.monotonic` [s], by name ("/finger1").
    """

    def __init__(self, url: str):
        import viser

        self.elements: dict[str, dict[str, Any]] = {}
        self.commands: dict[str, str] = {}
        self.vertices: dict[str, np.ndarray] = {}
        self.moments: dict[str, list[float]] = {}
        protocol: Any = f"viser-v{viser.__version__}"
        self._socket = connect(
            url.replace("http", "ws"), subprotocols=[protocol], compression=None, max_size=None, proxy=None
        )
        self._thread = threading.Thread(target=self._read, daemon=True)
        self.send(CAMERA)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()
        self._thread.join()

    def send(self, message: dict[str, Any]) -> None:
        """Send the page a message, as its browser part would."""
        self._socket.send(msgspec.msgpack.encode(message))

    def watch(self) -> None:
        """Return when the page has gone away."""
        self._thread.join()

    def _read(self) -> None:
        """Read until the page goes away; a packet is two lengths, then packed messages, then arrays."""
        while True:
            try:
                packet = self._socket.recv()
            except ConnectionClosed:
                return
            assert isinstance(packet, bytes)
            end = HEADER + int.from_bytes(packet[HEADER // 2 : HEADER], "little")
            self.take(msgspec.msgpack.decode(zstandard.decompress(packet[HEADER:end])), packet)

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

    def drag(self, body: str, phase: str, start: Sequence[float], end: Sequence[float]) -> None:
        """Drag a body with the left button and shift, from a place of it to another [mm]; "start", "update", "end"."""
        message = {
            "type": "SceneNodeDragMessage",
            "phase": phase,
            "name": f"/{body}",
            "instance_index": None,
            "start_position": [0.01 * float(one) for one in start],
            "start_screen_pos": [0.5, 0.5],
            "end_position": [0.01 * float(one) for one in end],
            "end_screen_pos": [0.5, 0.5],
            "button": "left",
            "modifier": "shift",
        }
        self.send(message)

    def value(self, label: str) -> Any:
        """Value of the element with a label."""
        return self.elements[self.find(label)]["value"]

    def take(self, content: dict[str, Any], packet: bytes) -> None:
        """Take note of the messages in the content of a packet; the arrays that they refer to end the packet."""
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
                self.moments.setdefault(message["name"], []).append(time.monotonic())
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
