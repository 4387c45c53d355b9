"""Cables on a page: lines that move with their points and have the colour of their tension, and their curves."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from cable_block import LINK, STEPS, TENDON, run_cables
from panel_viewer import served

from taichisoft import Control, Controller, Observation, Session
from taichisoft.mechanics import CABLES
from taichisoft_outputs import Recording, read_recording
from taichisoft_outputs.drawing.painting import LINE, ColourScale, round_up
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.web.address import find_address
from taichisoft_outputs.web.page_messages import lines_shown
from taichisoft_outputs.web.recording_page import instant_of
from taichisoft_outputs.web.web_output import page_setup, snapshot


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Recording]:
    folder = tmp_path_factory.mktemp("cables")
    run_cables(folder, [RecordingOutput(folder)])
    with read_recording(folder / "recording.h5") as opened:
        yield opened


class Idle(Controller):
    """Asks for nothing."""

    def control(self, observation: Observation) -> Control:
        return Control()


def test_lines_run_from_point_to_point_of_each_cable() -> None:
    points = [np.arange(9.0).reshape(3, 3), -np.arange(6.0).reshape(2, 3)]
    lines, tensions = lines_shown(points, [np.array([5.0, 4.0]), np.array([7.0])])
    assert lines[:, 0].tolist() == [[0, 1, 2], [3, 4, 5], [0, -1, -2]]
    assert lines[:, 1].tolist() == [[3, 4, 5], [6, 7, 8], [-3, -4, -5]]
    assert tensions.tolist() == [5.0, 4.0, 7.0]
    lines, tensions = lines_shown([], [])
    assert (lines.shape, tensions.shape) == ((0, 2, 3), (0,))


def test_a_live_page_shows_what_its_recording_shows(recording: Recording, tmp_path: Path) -> None:
    simulation = run_cables(tmp_path)
    session = Session(simulation, Idle(), duration=1.0)
    setup = page_setup(session, find_address("127.0.0.1:0"), snapshot(session, simulation.state))
    live, recorded = setup.first.instant, instant_of(recording, STEPS)
    assert list(setup.content.actuators.names) == recording.cables == [TENDON, LINK]
    np.testing.assert_array_equal(live.plotted, recorded.plotted)
    for shown, expected in zip(live.lines["cable"], recorded.lines["cable"], strict=True):
        np.testing.assert_array_equal(shown, expected)
    assert recorded.plotted[:2].tolist() == recording.row("tension", STEPS).tolist()
    assert recorded.lines["cable"].ends.shape == (5, 2, 3)
    np.testing.assert_array_equal(recorded.lines["cable"].ends[4], recording.cable_points(STEPS)[1])


def test_viewers_see_the_lines_move_and_the_curves(recording: Recording) -> None:
    pytest.importorskip("viser", reason="needs the extra 'web'")
    lines = instant_of(recording, STEPS).lines["cable"].ends.reshape(-1, 3)
    with served(recording.path) as (page, viewer, until):
        viewer.find("time [s]")
        until(lambda: np.allclose(100.0 * viewer.vertices["/cable lines"], lines, atol=1e-3))
        titles = [element.get("title") for element in viewer.elements.values()]
        assert "tension [mN]" in titles and "pressure [kPa]" not in titles
        colours = page.page.view._lines["cable"].colors
    tensions = np.concatenate(recording.segment_efforts(CABLES, STEPS))
    highest = round_up(recording.column("tension").max())
    expected = 255 * ColourScale("", 0.0, highest, LINE).colours(tensions)
    np.testing.assert_allclose(colours[:, 0], expected, atol=0.51)
    np.testing.assert_array_equal(colours[:, 0], colours[:, 1])


def test_a_page_without_cables_has_no_lines(tmp_path: Path) -> None:
    pytest.importorskip("viser", reason="needs the extra 'web'")
    run_cables(tmp_path, [RecordingOutput(tmp_path)], cables=False)
    with served(tmp_path / "recording.h5") as (_, viewer, until):
        until(lambda: viewer.value("time [s]") == pytest.approx(0.01 * STEPS))
        assert "/block" in viewer.vertices and "/cable lines" not in viewer.vertices
        assert "tension [mN]" not in [element.get("title") for element in viewer.elements.values()]
