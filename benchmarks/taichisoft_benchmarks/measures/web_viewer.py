"""A viewer of a web page that draws nothing: it speaks the language of viser's browser part.

`python -m taichisoft_benchmarks.measures.web_viewer URL` watches until the page goes away, then prints as JSON how
often a second each surface moved.
"""

import json
import sys
import threading
import time
from typing import Any, Self

PATIENCE = 30.0
"""For something to appear on the page [s]; usually at once."""

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


class Viewer:
    """Reads a page in a thread of its own; use it in a `with` statement.

    Attributes:
        elements: what the panel has, by identifier: label, value and other properties.
        commands: identifiers of hotkeys, by key ("arrowup").
        moments: when each surface of the scene has moved, on the clock of `time.monotonic` [s], by name ("/finger1").
        vertices: the newest of each surface, in the page's unit, shape (vertex_count, 3).
    """

    def __init__(self, url: str):
        """Connect, as a browser does that has loaded the page."""
        import viser
        from websockets.sync.client import connect

        self.elements: dict[str, dict[str, Any]] = {}
        self.commands: dict[str, str] = {}
        self.moments: dict[str, list[float]] = {}
        self.vertices: dict[str, Any] = {}
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
        """Tell the page something."""
        import msgspec

        self._socket.send(msgspec.msgpack.encode(message))

    def watch(self) -> None:
        """Return when the page has gone away."""
        self._thread.join()

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
        """Of the element with a label."""
        return self.elements[self.find(label)]["value"]

    def _read(self) -> None:
        from websockets.exceptions import ConnectionClosed

        while True:
            try:
                raw = self._socket.recv()
            except ConnectionClosed:
                return
            assert isinstance(raw, bytes)
            for message, arrays in _unpacked(raw):
                self._take(message, arrays)

    def _take(self, message: dict[str, Any], arrays: Any) -> None:
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
            self.vertices[message["name"]] = arrays(message["props"]["vertices"])
        elif kind == "SceneNodeUpdateMessage" and "vertices" in message["updates"]:
            name = message["name"]
            self.moments.setdefault(name, []).append(time.monotonic())
            self.vertices[name] = arrays(message["updates"]["vertices"])


def _unpacked(raw: bytes) -> Any:
    """Messages of a packet, each with what gives its arrays: two lengths, packed messages, then the arrays' bytes."""
    import msgspec
    import numpy as np
    import zstandard

    packed = int.from_bytes(raw[8:16], "little")
    content = msgspec.msgpack.decode(zstandard.decompress(raw[16 : 16 + packed]))
    starts, end = [], 16 + packed
    for length in content["binaryBufferLengths"]:
        start = end + (-end) % 8
        starts.append(start)
        end = start + length

    def arrays(placeholder: dict[str, Any]) -> Any:
        index = placeholder["__binary_index"]
        length = content["binaryBufferLengths"][index]
        return np.frombuffer(raw[starts[index] : starts[index] + length], placeholder["dtype"]).reshape(-1, 3)

    return [(message, arrays) for message in content["messages"]]


def main() -> None:
    """Watch the page."""
    with Viewer(sys.argv[1]) as viewer:
        viewer.watch()
    rates = {name: (len(at) - 1) / (at[-1] - at[0]) for name, at in viewer.moments.items() if len(at) > 1}
    print(json.dumps(rates))


if __name__ == "__main__":
    main()
