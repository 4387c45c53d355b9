"""The page of a run, seen by viewers that draw nothing: what they do reaches the run, and nothing else does."""

import json
import re
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from panel_viewer import PanelViewer

from taichisoft import Control, Controller, KeyEvent, Scene, Session, Simulation
from taichisoft.running.loop import run_session
from taichisoft.running.session import KeyReplay
from taichisoft_controllers.keyboard_controller import KeyboardController
from taichisoft_outputs.web.web_output import WebOutput

pytest.importorskip("viser", reason="needs the extra 'web'")

PATIENCE = 60.0
ADDRESS = "127.0.0.1:0"


class Running:
    """A run in a thread, with the page beside it.

    Attributes:
        session: the run.
        url: of its page.
        outcome: once it has ended.
    """

    def __init__(self, scene: Scene, folder: Path | None, address: str, controller: Any, speed: float, duration: float):
        self.output = WebOutput(folder or Path(), address)
        simulation = Simulation(scene)
        self.session = Session(simulation, controller, [self.output], duration, folder, speed)
        self.outcome = ""
        self._thread = threading.Thread(target=self._run)
        self._thread.start()
        self.wait_for(lambda: self.session.steps_made > 0)
        self.url = self.output.url

    def _run(self) -> None:
        self.outcome = run_session(self.session)

    def wait_for(self, condition: Callable[[], bool]) -> None:
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline and self._thread.is_alive(), f"waited in vain; {self.outcome}"
            time.sleep(0.01)

    def join(self) -> None:
        self._thread.join()

    def end(self) -> None:
        self.session.stop()
        self.join()


@pytest.fixture
def running(taichisoft_scene: Scene) -> Callable[..., Any]:
    """Starts the tiny gripper with a page in a `with` statement."""

    @contextmanager
    def start(
        folder: Path | None = None,
        address: str = ADDRESS,
        controller: Any = None,
        speed: float = 1.0,
        duration: float = np.inf,
    ) -> Iterator[Running]:
        run = Running(taichisoft_scene, folder, address, controller or KeyboardController(), speed, duration)
        try:
            yield run
        finally:
            run.end()

    return start


def has_pressures(run: Running, *expected: float) -> bool:
    """Whether the last step had these [kPa]; an imposed one is met to the last digits only."""
    report = run.session.simulation.report
    return report is not None and list(report.observation.pressures.values()) == pytest.approx(expected)


def test_controls_steer_the_run_and_their_log_replays(
    running: Callable[..., Any], tmp_path: Path, taichisoft_scene: Scene
) -> None:
    """To the last bit, with a pressure that has many digits, a pause and a new start."""
    with running(tmp_path) as run, PanelViewer(run.url) as viewer:
        viewer.set("left [kPa]", 10.0 / 3.0)
        run.wait_for(lambda: has_pressures(run, 10.0 / 3.0, 0.0))
        viewer.press("pageup")
        viewer.set("move up by 3 mm (↑)", True)
        run.wait_for(lambda: has_pressures(run, 10.0 / 3.0 + 1.0, 1.0))
        run.wait_for(lambda: run.session.simulation.state.base_translation[2] > 2.9)
        viewer.press("space")
        run.wait_for(lambda: run.session.paused)
        viewer.set("restart from the first state (r)", True)
        viewer.press("a")
        viewer.set("make a single step (s)", True)
        run.wait_for(lambda: run.session.simulation.state.step == 1)
        viewer.set("pause, and go on (space)", True)
        run.wait_for(lambda: run.session.simulation.state.step > 10)
    assert run.outcome == "stopped"
    keys = [json.loads(line) for line in (tmp_path / "keys.jsonl").read_text().splitlines()]
    assert keys[0]["key"] == "left.cavity" and keys[0]["value"] == 10.0 / 3.0
    again = Session(Simulation(taichisoft_scene), KeyboardController(), replay=KeyReplay(tmp_path / "keys.jsonl"))
    run_session(again)
    assert again.simulation.state == run.session.simulation.state


def test_dragged_bodies_are_pulled_and_the_log_replays(
    running: Callable[..., Any], tmp_path: Path, taichisoft_scene: Scene
) -> None:
    """The cube to the side until it is let go, beside a controller; its force is drawn and written; to the last bit."""
    with running(tmp_path, controller=Constant()) as run, PanelViewer(run.url) as viewer:
        simulation, along, up = run.session.simulation, np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
        external, place = simulation.model.external_forces, simulation.state.rigid_position[0]

        def force(body: str) -> Any:
            return external.seen(simulation.state)[external.names.index(body)]

        corner = place + 5.0 * (along + up)
        viewer.drag("cube", "start", corner, corner + 20.0 * along)
        run.wait_for(lambda: force("cube")[1] > 1.0)
        viewer.drag("cube", "update", corner, corner + 40.0 * along)
        run.wait_for(lambda: simulation.state.rigid_position[0, 1] > place[1] + 2.0)
        text = r"cube pulled by \d+ mN"
        run.wait_for(lambda: any(re.search(text, str(one)) for one in [*viewer.elements.values()]))
        viewer.drag("cube", "end", corner, corner)
        run.wait_for(lambda: not force("cube").any())
        tip = simulation.model.soft_bodies[0].rest_position[-1]
        viewer.drag("left", "start", tip, tip + 9.0 * up)
        run.wait_for(lambda: force("left")[2] > 0.1)
        viewer.drag("left", "end", tip, tip)
        run.wait_for(lambda: run.session.pull is None)
    again = Session(Simulation(taichisoft_scene), Constant(), replay=KeyReplay(tmp_path / "keys.jsonl"))
    run_session(again)
    assert again.simulation.state == run.session.simulation.state


def test_sliders_follow_keys_and_other_viewers(running: Callable[..., Any]) -> None:
    with running() as run, PanelViewer(run.url) as one, PanelViewer(run.url) as other:
        one.find("left [kPa]")
        run.session.keys.put(KeyEvent("+"))
        run.wait_for(lambda: one.value("left [kPa]") == other.value("right [kPa]") == 1.0)
        one.set("right [kPa]", 7.0)
        run.wait_for(lambda: other.value("right [kPa]") == 7.0)
        time.sleep(0.5)
        assert has_pressures(run, 1.0, 7.0)
        assert [str(event) for event in run.session.recent_keys] == ["+", "right.cavity=7"]


def test_the_page_shows_where_the_bodies_are(running: Callable[..., Any]) -> None:
    """Every drawn vertex of the silicone is one of the mesh, and the cube is drawn where it is."""
    with running() as run, PanelViewer(run.url) as viewer:
        viewer.set("left [kPa]", 5.0)
        run.wait_for(lambda: has_pressures(run, 5.0, 0.0))
        time.sleep(0.3)
        viewer.press("space")
        run.wait_for(lambda: run.session.paused)
        state = run.session.simulation.state
        left = run.session.simulation.model.soft_bodies[0]
        expected = left.surface.positions(state.position[left.nodes]).max(axis=0)
        run.wait_for(lambda: np.allclose(100.0 * viewer.vertices["/left"].max(axis=0), expected, atol=1e-3))
        assert np.allclose(100.0 * viewer.vertices["/cube"].mean(axis=0), state.rigid_position[0], atol=1e-3)


class Constant(Controller):
    """Heeds no keys."""

    def control(self, observation: Any) -> Control:
        return Control(pressure=dict.fromkeys(observation.pressures, 4.0))


def test_page_without_sliders_shows_pressures(running: Callable[..., Any]) -> None:
    with running(controller=Constant()) as run, PanelViewer(run.url) as viewer:
        gauges = r"left \[kPa\]<br><b[^>]*>4\.0</b>.*right \[kPa\]<br><b[^>]*>4\.0</b>"
        run.wait_for(lambda: any(re.search(gauges, str(one), re.S) for one in [*viewer.elements.values()]))
        viewer.set("speed [x real time]", 0.5)
        run.wait_for(lambda: run.session.pace.speed == 0.5)
        assert not any("move" in str(element.get("label")) for element in viewer.elements.values())
        assert has_pressures(run, 4.0, 4.0)
        assert not run.session.recent_keys


def test_viewers_who_leave_or_read_nothing_change_nothing(
    running: Callable[..., Any], tmp_path: Path, taichisoft_scene: Scene
) -> None:
    """The bits are those of a run without a page."""
    import viser

    plain = Session(Simulation(taichisoft_scene), Constant(), duration=3.0)
    run_session(plain)
    with (
        running(controller=Constant(), speed=2.0, duration=3.0) as run,
        socket.create_connection(("127.0.0.1", urlsplit(run.url).port)) as deaf,
    ):
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        deaf.sendall(
            b"GET /?" + urlsplit(run.url).query.encode() + b" HTTP/1.1\r\nHost: 127.0.0.1\r\n"
            b"Upgrade: websocket\r\nConnection: Upgrade\r\n"
            b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n"
            b"Sec-WebSocket-Protocol: viser-v" + viser.__version__.encode() + b"\r\n\r\n"
        )
        with PanelViewer(run.url):
            time.sleep(0.3)
        run.join()
    assert run.outcome == "completed"
    assert run.session.simulation.state == plain.simulation.state


def test_the_run_survives_its_page(running: Callable[..., Any], recwarn: pytest.WarningsRecorder) -> None:
    with running() as run:
        process = run.output._link._worker.process
        process.kill()
        run.wait_for(lambda: any("the web page is gone; the run goes on" in str(w.message) for w in recwarn))
        steps = run.session.steps_made
        run.wait_for(lambda: run.session.steps_made > steps + 5)
    assert run.outcome == "stopped"
    with running() as run:
        process = run.output._link._worker.process
    assert process.poll() == 0
