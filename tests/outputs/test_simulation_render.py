"""`Simulation.render`: pictures of the present state, from a process that stays."""

import os
import signal

import numpy as np
import pytest

from taichisoft import Control, Scene, Simulation
from taichisoft.errors import PluginError, TaichisoftError
from taichisoft_outputs.rendering.live_renderer import LiveRenderer

SMALL = (160, 120)


def process_id(simulation: Simulation) -> int:
    (renderer,) = simulation._kept.values()
    return renderer._process.worker.process.pid  # type: ignore[attr-defined]


def blue(picture: np.ndarray) -> np.ndarray:
    """Rows and columns of the pixels that show the cube, the only thing that is blue."""
    red, _, blue = np.moveaxis(picture.astype(int), -1, 0)
    return np.argwhere(blue > red + 60)


def test_a_picture_shows_the_present_state_and_its_process_stays_and_is_replaced(taichisoft_scene: Scene) -> None:
    simulation = Simulation(taichisoft_scene)
    start = simulation.state
    first = simulation.render("front", SMALL)
    process = process_id(simulation)
    assert first.shape == (120, 160, 3)
    assert first.dtype == np.uint8
    simulation.restore(start.changed(rigid_position=start.rigid_position + np.array([0.0, 0.0, 10.0])))
    risen = simulation.render("front", SMALL)
    # The pads are 52 mm apart, which is most of the picture's width: 10 mm are more than ten pixels.
    assert blue(risen)[:, 0].mean() < blue(first)[:, 0].mean() - 10
    assert process_id(simulation) == process
    os.kill(process, signal.SIGKILL)
    simulation.restore(start)
    with pytest.warns(UserWarning, match="the renderer stopped: .*; another takes its place"):
        again = simulation.render("front", SMALL)
    assert np.array_equal(again, first)
    simulation.close()
    assert not simulation._kept


def test_a_picture_that_is_interrupted_is_not_taken_for_the_next_one(taichisoft_scene: Scene) -> None:
    """Ctrl and c while the picture is drawn: what the process still sends belongs to no later picture."""
    renderer = LiveRenderer(Simulation(taichisoft_scene).model, SMALL, "front")
    ended = []

    class Interrupted:
        drawn = 0

        def draw(self, state: object, marks: object, camera: object) -> None:
            raise KeyboardInterrupt

        def end(self) -> None:
            ended.append(self)

    renderer._process = Interrupted()  # type: ignore[assignment]
    with pytest.raises(KeyboardInterrupt):
        renderer.picture(Simulation(taichisoft_scene).state, np.zeros((0, 3)))
    assert ended
    assert renderer._process is None


def test_a_camera_at_a_point_looks_where_it_is_told(taichisoft_scene: Scene) -> None:
    simulation = Simulation(taichisoft_scene)
    simulation.step(Control(pressure={"left.cavity": 1.0}))
    middle = blue(simulation.render(((0.0, -150.0, 5.2), (0.0, 0.0, 5.2)), SMALL)).mean(axis=0)
    assert np.allclose(middle, [59.5, 79.5], atol=3.0)
    simulation.close()


def test_a_mark_is_seen_where_its_point_is_also_behind_a_body(taichisoft_scene: Scene) -> None:
    simulation = Simulation(taichisoft_scene)
    camera = ((0.0, -150.0, 5.2), (0.0, 0.0, 5.2))
    plain = simulation.render(camera, SMALL).astype(int)
    marked = simulation.render(camera, SMALL, marks=[[0.0, 20.0, 5.2], [0.0, -400.0, 5.2]]).astype(int)
    changed = np.argwhere(np.abs(marked - plain).max(axis=-1) > 20)
    assert len(changed) > 5  # and what is behind the camera is nowhere
    assert np.allclose(changed.mean(axis=0), [59.5, 79.5], atol=1.0)
    assert np.abs(changed - [59.5, 79.5]).max() < 5
    simulation.close()


@pytest.mark.parametrize(
    ("camera", "size", "problem"),
    [
        ("above", SMALL, "no view is called 'above'"),
        ("orbit", SMALL, "camera 'orbit' needs a whole run"),
        ("follow:ball", SMALL, "no body is called 'ball'; there are: left, right, cube"),
        (((0.0, 0.0, 0.0),), SMALL, "two points"),
        ("iso", (4, 4), "from 16 to 8192 pixels"),
    ],
)
def test_what_cannot_be_drawn_is_refused(
    taichisoft_scene: Scene, camera: object, size: tuple[int, int], problem: str
) -> None:
    with pytest.raises(TaichisoftError, match=problem):
        Simulation(taichisoft_scene).render(camera, size)  # type: ignore[arg-type]


def test_a_renderer_that_nobody_provides_is_refused(taichisoft_scene: Scene) -> None:
    with pytest.raises(PluginError, match="no renderer is called 'paint'; there are: open3d"):
        Simulation(taichisoft_scene).render(renderer="paint")
