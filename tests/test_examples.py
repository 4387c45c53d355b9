"""The programs in examples/ print what their docstrings say.

They run in this process, one after the other, so that Taichi loads its kernels once; it takes longer than they do.
The physics is deterministic: the same machine prints the same digits every time. Another processor rounds otherwise in
the sixteenth digit, which can turn the last one printed; therefore a figure may differ by one in its last decimal.
Words, counts and settings are the same everywhere.
"""

import ast
import contextlib
import functools
import io
import itertools
import json
import re
import runpy
import socket
import sys
import threading
from contextlib import redirect_stdout
from pathlib import Path
from tempfile import TemporaryDirectory
from textwrap import dedent
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from conftest import PATIENCE
from documents import ROOT, blocks

from taichisoft.running import hooks, plugins

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
PROGRAMS = sorted(EXAMPLES.glob("*.py"))
MEASURED = re.compile(r"-?\d+\.\d+")


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda program: program.stem)
def test_example_prints_what_its_docstring_says(program: Path) -> None:
    docstring = ast.get_docstring(ast.parse(program.read_text(encoding="utf-8"))) or ""
    expected = dedent(docstring.partition("\nPrints:\n\n")[2])
    assert expected, f"{program.name}: its docstring must end with 'Prints:' and what it prints"
    printed, _ = execute(program.stem)
    assert MEASURED.sub("#", printed).split() == MEASURED.sub("#", expected).split(), printed
    for figure, promised in zip(MEASURED.findall(printed), MEASURED.findall(expected), strict=True):
        decimals = len(promised.partition(".")[2])
        close = abs(float(figure) - float(promised)) < 1.5 * 10.0**-decimals
        assert close, f"{figure} instead of {promised}:\n{printed}"


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda program: program.stem)
def test_readme_lists_it_with_its_command(program: Path) -> None:
    rows = (EXAMPLES / "README.md").read_text(encoding="utf-8").splitlines()
    (row,) = [row for row in rows if f"]({program.name})" in row]
    assert f"`python examples/{program.name}" in row


def test_readme_lists_nothing_else() -> None:
    listed = re.findall(r"\]\((\w+\.py)\)", (EXAMPLES / "README.md").read_text(encoding="utf-8"))
    assert sorted(listed) == [program.name for program in PROGRAMS]


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda program: program.stem)
def test_example_is_short_and_uses_public_names(program: Path) -> None:
    text = program.read_text(encoding="utf-8")
    code = text.split('"""', 2)[2]  # without the docstring, half of which is the output
    assert len([line for line in code.splitlines() if line.strip()]) <= 60
    imported = re.findall(r"^(?:from|import) (taichisoft\S*)", text, re.MULTILINE)
    documented = "taichisoft_outputs"  # docs/recording.md tells users to read recordings with it
    assert "taichisoft" in imported
    assert set(imported) <= {"taichisoft", "taichisoft.errors", documented}


def test_notebook_shows_picture_video_and_error_of_one_line() -> None:
    nbclient = pytest.importorskip("nbclient", reason="needs the extra 'test'")
    pytest.importorskip("ipykernel", reason="needs the extra 'notebook'")
    nbformat = pytest.importorskip("nbformat")
    notebook = nbformat.read(EXAMPLES / "gripper.ipynb", as_version=4)
    nbclient.NotebookClient(notebook, timeout=PATIENCE).execute()
    shown = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    kinds = [kind for output in shown for kind in output.get("data", {})]
    assert "image/png" in kinds and "application/vnd.jupyter.widget-view+json" in kinds
    assert any("video/mp4" in output.get("data", {}).get("text/html", "") for output in shown)
    ((line,),) = [output.traceback for output in shown if output.output_type == "error"]
    assert line.startswith("ControlError, line 1: control.pressure: no cavity is called 'finger9.cavity'; did you mean")


def test_bridge_follows_its_peer_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stranger answers first, with the right time; the peer's packets are broken three times out of four."""
    peer, stranger = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    peer.bind(("127.0.0.1", 0))
    wrong = (b"[1]", b'{"x": 3.0}', *(b'{"finger.cavity": %s}' % value for value in (b"NaN", b"1e300", b'"3"')))
    answers = itertools.cycle(
        [b"\xff\x00", b"5", b"{}", b"[" * 9999]
        + [b'{"time": %%s, "pressure": %s}' % value for value in wrong]
        + [b'{"time": %s, "pressure": {"finger.cavity": 3.0}}'] * 3
    )

    def answer() -> None:
        with contextlib.suppress(OSError):  # the socket is closed at the end
            while True:
                message, sender = peer.recvfrom(65536)
                now = json.dumps(json.loads(message)["time"]).encode()
                stranger.sendto(b'{"time": %s, "pressure": {"finger.cavity": 9.0}}' % now, sender)
                peer.sendto(next(answers).replace(b"%s", now), sender)

    threading.Thread(target=answer, daemon=True).start()
    monkeypatch.setattr(sys, "argv", ["bridge.py", f"127.0.0.1:{peer.getsockname()[1]}"])
    with peer, stranger, redirect_stdout(io.StringIO()) as printed:
        names = runpy.run_path(str(EXAMPLES / "bridge.py"))
    assert printed.getvalue().startswith("100 observations went out, ")
    assert names["seen"].pressures["finger.cavity"] <= 3.0 + 1e-9


class StandIn(SimpleNamespace):
    """Any node or message of ROS 2: keeps what is published, and which functions it would call."""

    def __init__(self, *_: Any, **fields: Any):
        super().__init__(header=SimpleNamespace(stamp=None), published=[], **fields)

    def create_publisher(self, kind: type, topic: str, depth: int) -> "StandIn":
        return StandIn(topic=topic)

    def create_subscription(self, kind: type, topic: str, call: Any, depth: int) -> None:
        self.subscribed = {topic: call}

    def create_timer(self, period: float, call: Any) -> None:
        self.timer = call

    def publish(self, message: Any) -> None:
        self.published.append(message)

    def to_msg(self) -> float:
        return self.seconds


def test_node_of_ros_carries_observations_and_commands(monkeypatch: pytest.MonkeyPatch) -> None:
    """docs/ros2.md over real sockets, with stand-ins for what ROS brings."""
    for module, name in (
        *(("rclpy", ""), ("rclpy.node", "Node"), ("rclpy.time", "Time"), ("sensor_msgs", "")),
        *(("sensor_msgs.msg", "JointState"), ("std_msgs", ""), ("std_msgs.msg", "Float64MultiArray")),
    ):
        made = ModuleType(module)
        setattr(made, name or "nothing", StandIn)
        monkeypatch.setitem(sys.modules, module, made)
    ((_, code),) = [block for block in blocks(ROOT / "docs" / "ros2.md") if block[0] == "python"]
    names: dict[str, Any] = {"__name__": "bridge_node"}
    exec(code, names)
    node, over = names["BridgeNode"](port=0), threading.Event()
    node.subscribed["taichisoft/command"](StandIn(data=[3.0]))

    def spin() -> None:
        while not over.wait(0.0005):
            node.timer()

    thread = threading.Thread(target=spin)
    thread.start()
    monkeypatch.setattr(sys, "argv", ["bridge.py", f"127.0.0.1:{node.link.getsockname()[1]}"])
    with redirect_stdout(io.StringIO()):
        seen = runpy.run_path(str(EXAMPLES / "bridge.py"))["seen"]
    over.set()
    thread.join()
    for _ in range(100):  # what came while the last answers were made
        node.timer()
    with node.link:
        fingers, pressures = node.fingers.published, node.pressures.published
    assert seen.pressures["finger.cavity"] == pytest.approx(3.0)
    assert len(fingers) == len(pressures) == 100 and pressures[-1].data == pytest.approx([3.0])
    assert fingers[-1].name == ["finger"] and fingers[-1].header.stamp == pytest.approx(0.99)
    assert fingers[-1].position == pytest.approx([seen.bending_angles["finger"]], abs=1e-3)


def test_forces_of_all_contacts_carry_cube() -> None:
    """It is at rest: contact forces and weight add up to zero, to what the tolerance of the solver leaves."""
    _, names = execute("contact_forces")
    np.testing.assert_allclose(names["total"] + names["weight"], 0.0, atol=0.01)


def test_can_weighs_what_its_prism_weighs() -> None:
    """A cylinder of n sections has the base area n/2 r^2 sin(2 pi/n)."""
    _, names = execute("own_object")
    area = 6.0 * names["RADIUS"] ** 2 * np.sin(np.pi / 6.0)
    mass = names["simulation"].model.rigid_mass[0]
    assert mass == pytest.approx(area * names["HEIGHT"] * names["DENSITY"], rel=1e-6)  # the file has single precision


def test_geometry_is_plugin() -> None:
    with plugins.separate_registry():
        plugins.load_plugin(EXAMPLES / "own_geometry.py")
        geometry = hooks.find("geometry kind", "hollow-bar")({"cells": [4, 3, 3], "size": 2.0}, Path("bar.toml"))
    mesh = geometry.mesh().check()
    corners = mesh.nodes[mesh.surface_groups["cavity"]]
    volume = np.linalg.det(corners).sum() / 6.0
    assert volume == pytest.approx(2 * 2.0**3)  # two cubes inside; positive where the triangles point into the silicone


@functools.cache
def execute(name: str) -> tuple[str, dict[str, Any]]:
    """What an example prints, and its variables at the end."""
    out = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, TemporaryDirectory() as folder, redirect_stdout(out):
        patch.setattr(sys, "argv", [f"{name}.py", str(Path(folder) / "new")])
        names = runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
    return out.getvalue(), names
