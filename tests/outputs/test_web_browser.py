"""The page in a real browser: what it draws and what its keys and buttons do. Skipped where none can be driven."""

import io
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from chromium import chromium
from conftest import PATIENCE

from taichisoft import Session, Simulation, load_scene
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.running.loop import run_session
from taichisoft_controllers.keyboard_controller import KeyboardController
from taichisoft_outputs import read_recording
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.web.address import find_address
from taichisoft_outputs.web.page import Page
from taichisoft_outputs.web.page_messages import PageScene
from taichisoft_outputs.web.recording_page import instant_of
from taichisoft_outputs.web.web_output import WebOutput

pytest.importorskip("viser", reason="needs the extra 'web'")


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    """The tiny gripper with a page, paused at its start."""
    output = WebOutput(tmp_path / "run", "127.0.0.1:0")
    running = Session(Simulation(load_scene(TINY_GRIPPER)), KeyboardController(), [output], np.inf, speed=1.0)
    running.paused = True
    thread = threading.Thread(target=run_session, args=(running,))
    thread.start()
    try:
        wait_for(lambda: output.url != "")
        yield running
    finally:
        running.stop()
        thread.join()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as opened:
        yield opened


def wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.02)


def opened(browser: Any, session: Session) -> Any:
    """A tab with the page: what can be clicked is there."""
    (output,) = session.outputs
    tab = browser.new_page(viewport={"width": 560, "height": 320})
    tab.set_default_timeout(1e3 * PATIENCE)
    errors: list[str] = []
    tab.on("pageerror", lambda error: errors.append(str(error)))
    tab.goto(output.url)  # type: ignore[attr-defined]
    tab.get_by_role("button", name="make a single step").wait_for(state="attached")
    assert not errors, errors
    return tab


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_page_follows_the_theme_of_the_browser(browser: Any, session: Session, scheme: str) -> None:
    (output,) = session.outputs
    tab = browser.new_page(viewport={"width": 560, "height": 320}, color_scheme=scheme)
    tab.goto(output.url)  # type: ignore[attr-defined]
    tab.wait_for_selector(f"[data-mantine-color-scheme={scheme}]", state="attached", timeout=1e3 * PATIENCE)
    canvas = tab.wait_for_selector("canvas[data-engine]", state="attached", timeout=1e3 * PATIENCE)
    colour = canvas.evaluate("canvas => getComputedStyle(canvas).backgroundColor")
    assert (colour == "rgb(20, 20, 20)") is (scheme == "dark"), "behind the scene"
    tab.emulate_media(color_scheme="dark" if scheme == "light" else "light")
    tab.wait_for_selector(f"html:not([data-mantine-color-scheme={scheme}])", state="attached", timeout=1e3 * PATIENCE)


def drawn(tab: Any) -> np.ndarray:
    """What the panel leaves free, once it stands still: red, green and blue, shape (height, width, 3)."""
    pictures = [_screenshot(tab), _screenshot(tab)]
    deadline = time.monotonic() + PATIENCE
    while np.abs(pictures[-1] - pictures[-2]).mean() > 1e-4:
        assert time.monotonic() < deadline, "the page does not come to rest"
        pictures.append(_screenshot(tab))
    return pictures[-1]


def _screenshot(tab: Any) -> np.ndarray:
    import matplotlib.image

    shot = matplotlib.image.imread(io.BytesIO(tab.screenshot()))
    return shot[:, : shot.shape[1] // 2, :3]


def test_silicone_looks_alike_whatever_the_order_of_its_triangles(browser: Any, tmp_path: Path) -> None:
    """The walls of the gaps of a finger lie behind each other: some triangles of them showed as white shards."""
    simulation, output = Simulation(load_scene("finger-inflated")), RecordingOutput(tmp_path)
    output.begin(simulation.model, simulation.state)
    output.end("completed")
    pictures, address = [], find_address("127.0.0.1:0")
    with read_recording(tmp_path / "recording.h5") as recording:
        for order in (1, -1):
            surfaces = [replace(one, triangles=one.triangles[::order].copy()) for one in recording.body_surfaces]
            content = PageScene(recording.scene, surfaces, recording.planes, recording.actuators)
            page = Page(address.host, 0, address.token, content, instant_of(recording, 0))
            tab = browser.new_page(viewport={"width": 1000, "height": 500})
            tab.goto(address.at(page.port).url)
            wait_for(lambda tab=tab: _screenshot(tab)[60:440].std(axis=(0, 1)).max() > 0.05)
            pictures.append(drawn(tab))
            tab.close()
            page.server.stop()
    assert np.abs(pictures[1] - pictures[0]).max(axis=-1).mean() < 1e-4


def pressure(session: Session) -> float:
    report = session.simulation.report
    return report.observation.pressures["left.cavity"] if report is not None else 0.0


def test_keys_and_buttons_inflate_what_the_page_shows(browser: Any, session: Session) -> None:
    """The pictures at 0 and at 6 kPa, 3 mm higher, differ, and none is blank; arrows leave the camera where it is."""
    tab = opened(browser, session)
    before = drawn(tab)
    assert before.std(axis=(0, 1)).max() > 0.05, "the canvas is blank"
    for _ in range(5):
        tab.keyboard.press("PageUp")
    tab.get_by_role("button", name="raise the pressure by 1 kPa (PgUp)").click()
    tab.keyboard.press("ArrowUp", delay=300)
    wait_for(lambda: session.controller.sliders["left.cavity"].value == 6.0)
    still = drawn(tab)
    tab.keyboard.press("Space")
    wait_for(lambda: pressure(session) > 5.9 and session.simulation.state.base_translation[2] > 2.9)
    tab.keyboard.press("Space")
    wait_for(lambda: session.paused)
    assert np.abs(still - before).mean() < 0.001, "the camera moved, or the run was not paused"
    # The page says "paused" from the start, so that the text does not tell when the last state has been drawn.
    wait_for(lambda: np.abs(drawn(tab) - before).mean() > 0.002)


def silicone(tab: Any) -> np.ndarray:
    """Rows and columns of the pixels of silicone, which is greener than red, shape (count, 2)."""
    picture = _screenshot(tab)
    return np.argwhere(picture[..., 1] - picture[..., 0] > 0.08)


def test_dragging_with_shift_pulls_a_pad(browser: Any, session: Session) -> None:
    """Until the button is released."""
    tab = opened(browser, session)
    wait_for(lambda: len(silicone(tab)) > 500)
    row, column = np.median(silicone(tab), axis=0)
    tab.keyboard.down("Shift")
    tab.mouse.move(column, row)
    tab.mouse.down()
    for step in range(1, 6):
        tab.mouse.move(column, row - 4 * step)
    wait_for(lambda: session.pull is not None)
    pull = session.pull
    assert pull is not None and pull.body in ("left", "right")
    tab.mouse.up()
    tab.keyboard.up("Shift")
    wait_for(lambda: session.pull is None)
