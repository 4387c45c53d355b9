"""Requests to the page of a run from foreign hosts and origins, and senseless messages of viewers."""

import http.client
import random
import re
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import urlsplit

from taichisoft.base import PYTHON
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft_benchmarks.measures.web_viewer import CAMERA, Viewer

PATIENCE = 300.0
"""Longest time until the page is there, or answers [s]."""
REGARD = 2.0
"""Time in which surfaces must move on the page after all messages [s]."""
SITES = ("evil.example", "localhost.evil.example", "127.0.0.1.evil.example", "127.0.0.1@evil.example", "10.0.0.1", "")
SCHEMES = ("http", "https", "file", "ftp", "chrome-extension", "null")
TYPES = (
    "GuiUpdateMessage", "CommandTriggerMessage", "ViewerCameraMessage", "ScenePointerMessage", "SceneNodeClickMessage",
    "SceneNodeDragMessage", "TransformControlsUpdateMessage", "GetRenderResponseMessage", "FileTransferStartUpload",
    "FileTransferPart", "FileTransferPartAck", "ShareUrlRequest", "ShareUrlDisconnect", "GuiFormSubmitMessage",
    "RunJavascriptMessage", "ResetGuiMessage", "NoSuchMessage",
)  # fmt: skip
"""Types of messages that a browser may send, some that only a server sends, and an unknown one."""
VALUES: tuple[Any, ...] = (
    None, True, 0, -1, 2**63, 1e300, float("nan"), float("inf"), "", "x", "x" * 100_000, "__proto__", b"\xff", [], {},
    [1e300] * 3, [None] * 4, {"value": "x"}, {"value": float("nan")}, {"value": []}, {"visible": 3, "no such": 1},
)  # fmt: skip
KEYS = (
    "uuid", "updates", "value", "name", "position", "wxyz", "source_component_uuid", "transfer_uuid", "part_index", "x",
)  # fmt: skip


@dataclass
class RunWithPage:
    """A run in a process of its own, with a page.

    Attributes:
        url: address of the page, with its token.
        lines: what the run has written so far.
    """

    process: subprocess.Popen[str]
    url: str = ""
    lines: list[str] = field(default_factory=list)

    def read(self) -> None:
        """Read what it writes until it ends."""
        assert self.process.stdout
        for line in self.process.stdout:
            self.lines.append(line)
            if found := re.search(r"http://\S+", line):
                self.url = self.url or found.group()


@contextmanager
def run_with_page() -> Iterator[RunWithPage]:
    """The tiny gripper in real time, without input."""
    with TemporaryDirectory() as folder:
        arguments = ["run", str(TINY_GRIPPER), "--controller", "keyboard", "--web", "--web-address", "127.0.0.1:0"]
        arguments += ["--duration", "3600", "--outputs", "", "-o", str(Path(folder) / "run")]
        process = subprocess.Popen(
            [*PYTHON, "-m", "taichisoft", *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        run = RunWithPage(process)
        threading.Thread(target=run.read, daemon=True).start()
        try:
            deadline = time.monotonic() + PATIENCE
            while not run.url and process.poll() is None and time.monotonic() < deadline:
                time.sleep(0.05)
            if not run.url:
                raise RuntimeError(f"no page: {run.lines[-3:]}")
            yield run
        finally:
            process.terminate()
            process.wait()


def foreign_requests(tries: int) -> list[str]:
    """Send requests that come from elsewhere, with the right token; each must be refused."""
    with run_with_page() as run:
        let_in = [number for number in range(tries) if _let_in(run.url, random.Random(f"origin {number}"))]
    return [f"{number}: let in" for number in let_in]


def _let_in(url: str, dice: random.Random) -> bool:
    """Whether a request with a foreign Host, or for the WebSocket with a foreign Origin, is answered with either."""
    page = urlsplit(url)
    port = dice.choice(["", f":{page.port}", ":1"])
    host = f"{page.hostname}:{page.port}"
    headers = {"Host": host}
    websocket = dice.random() < 0.7
    if websocket:
        headers |= {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13"}
        headers |= {"Sec-WebSocket-Key": "MDEyMzQ1Njc4OWFiY2RlZg=="}
        scheme = dice.choice(SCHEMES)
        headers["Origin"] = "null" if scheme == "null" else f"{scheme}://{dice.choice(SITES)}{port}"
    if not websocket or dice.random() < 0.4:
        headers["Host"] = dice.choice([site for site in SITES if site != "10.0.0.1"]) + port
    connection = http.client.HTTPConnection(page.hostname or "", page.port, timeout=PATIENCE)
    connection.putrequest("GET", f"/?{page.query}", skip_host=True)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    status = connection.getresponse().status
    connection.close()
    return status < 400


def senseless_messages(tries: int) -> list[str]:
    """Send messages, each on a connection of its own; the run and its page must go on, without a traceback."""
    import viser
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect

    protocol: Any = f"viser-v{viser.__version__}"
    with run_with_page() as run:
        address = run.url.replace("http", "ws")
        for number in range(tries):
            with (
                connect(address, subprotocols=[protocol], compression=None, max_size=None, proxy=None) as one,
                suppress(ConnectionClosed),
            ):
                one.send(_message(random.Random(f"message {number}")))
                one.recv(timeout=PATIENCE)
        return _after_all(run)


def _message(dice: random.Random) -> bytes:
    import msgspec

    if dice.random() < 0.2:
        return dice.randbytes(dice.choice([0, 1, 10, 1000]))
    message: Any = dict(CAMERA) if dice.random() < 0.3 else {"type": dice.choice(TYPES)}
    for _ in range(dice.randrange(5)):
        message[dice.choice([*KEYS, *CAMERA])] = dice.choice(VALUES)
    if dice.random() < 0.1:
        message = dice.choice([None, 1, "x", [message], {}, {"type": None}, {"type": "_GuiUpdate"}])
    packed = msgspec.msgpack.encode(message)
    if dice.random() < 0.2:
        place = dice.randrange(len(packed))
        packed = packed[:place] + dice.randbytes(1) + packed[place + 1 :]
    return packed


def _after_all(run: RunWithPage) -> list[str]:
    """Whether the run goes on, its page shows so, and nothing but its own lines stands on the terminal."""
    problems = []
    if run.process.poll() is not None:
        return [f"the run has ended: {run.lines[-1:]}"]
    with Viewer(run.url) as viewer:
        time.sleep(REGARD)
    if not any(len(moments) > 1 for moments in viewer.moments.values()):
        problems.append("nothing moves on the page any more")
    problems += [line.strip() for line in run.lines if "Traceback" in line or "Error" in line]
    return problems


ROWS = {
    "requests to a page, with its token, that come from foreign hosts and origins": (40, foreign_requests),
    "messages to a page that make no sense": (300, senseless_messages),
}
