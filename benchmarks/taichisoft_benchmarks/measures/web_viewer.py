"""A viewer of a web page that draws nothing: it uses the protocol of viser's browser part.

`python -m taichisoft_benchmarks.measures.web_viewer URL` watches until the page goes away, then prints as JSON how
often a second each surface moved.
"""

import json
import sys
import threading
import time
from typing import Any, Self

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


class Viewer:
    """Reads a page in a thread of its own; use it in a `with` statement.

    Attributes:
        moments: when each surface of the scene has moved, on the clock of `time.monotonic` [s], by name ("/finger1").
    """

    def __init__(self, url: str):
        """Connect, as a browser does that has loaded the page."""
        import viser
        from websockets.sync.client import connect

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
        import msgspec

        self._socket.send(msgspec.msgpack.encode(message))

    def watch(self) -> None:
        """Return when the page has gone away."""
        self._thread.join()

    def take(self, content: dict[str, Any], packet: bytes) -> None:
        """Take note of the messages in the content of a packet; the arrays that they refer to end the packet."""
        for message in content["messages"]:
            if message["type"] == "SceneNodeUpdateMessage" and "vertices" in message["updates"]:
                self.moments.setdefault(message["name"], []).append(time.monotonic())

    def _read(self) -> None:
        """Read until the page goes away; a packet is two lengths, then packed messages, then arrays."""
        import msgspec
        import zstandard
        from websockets.exceptions import ConnectionClosed

        while True:
            try:
                packet = self._socket.recv()
            except ConnectionClosed:
                return
            assert isinstance(packet, bytes)
            end = HEADER + int.from_bytes(packet[HEADER // 2 : HEADER], "little")
            self.take(msgspec.msgpack.decode(zstandard.decompress(packet[HEADER:end])), packet)


def main() -> None:
    """Watch the page, and print how often each surface moved."""
    with Viewer(sys.argv[1]) as viewer:
        viewer.watch()
    rates = {name: (len(at) - 1) / (at[-1] - at[0]) for name, at in viewer.moments.items() if len(at) > 1}
    print(json.dumps(rates))


if __name__ == "__main__":
    main()
