"""A page that shows frames, be they of a run or of a recording."""

from typing import Any

import numpy as np

from taichisoft_outputs.web.address import WebError
from taichisoft_outputs.web.curves import Curves
from taichisoft_outputs.web.frame import PageFrame, PageScene
from taichisoft_outputs.web.guard import Guard, guarded
from taichisoft_outputs.web.scene_view import ASPECT, SceneView

FREE = 0.4
"""Share of the height of a window, from the top, that viser's panel leaves free where the window is narrow [-]."""

SPEEDS = (0.05, 4.0)
"""Lowest and highest speed of a slider, simulated over wall-clock time."""

# A browser moves its camera by letters and arrows that steer the gripper here. Its handler sits behind the handlers of
# the hotkeys, so that a key which goes no further than they do turns the gripper and not the picture.
KEEP_KEYS_FROM_CAMERA = (
    '<img hidden src="data:," onerror="document.documentElement.addEventListener('
    "'keydown', event => event.stopPropagation())\">"
)


class Page:
    """A server with the scene, a line of text and the plots.

    Attributes:
        server: server of viser, to which controls can be added.
        port: port at which it listens.
        view: the scene.
        curves: the plots.
    """

    def __init__(self, host: str, port: int, token: str, content: PageScene, first: PageFrame):
        """Serve viewers who know the token, at an address of `find_address`.

        Raises:
            WebError: the port was taken in the meantime, or this version of viser cannot be guarded.
        """
        self.server = make_server(host, port, token)
        self.port = self.server.get_port()
        if port and self.port != port:
            self.server.stop()
            raise WebError(f"port {port} of {host} is taken")
        self.view = SceneView(self.server, content, first)
        gui = self.server.gui
        gui.set_panel_label(content.scene.title or "taichisoft")
        gui.main_panel.dock_right()
        gui.configure_theme(control_width="medium", show_logo=False, show_share_button=False)
        self._text = gui.add_markdown("", order=0.0)
        self.view.put_scales(gui.add_html("", order=0.5))
        with gui.add_folder("plots", order=100.0):
            self.curves = Curves(gui, content)
        self.server.on_client_connect(self._fit_window)

    def set_status(self, text: str) -> None:
        """Put a line of Markdown above everything."""
        self._text.content = text

    async def _fit_window(self, client: Any) -> None:
        """In a window that is higher than wide, such as a phone's, have everything above the panel."""
        first = self.server.initial_camera

        # A browser begins with a camera of its own, and tells when it has the first one of this page.
        def fit(camera: Any) -> None:
            if camera.aspect < 1.0 and np.allclose(camera.position, first.position, rtol=1e-3):
                seen = first.position, first.look_at, first.up, first.fov
                camera.position, camera.look_at = view_above_panel(*seen, camera.aspect)

        client.camera.on_update(fit)


def view_above_panel(
    eye: np.ndarray, target: np.ndarray, up: np.ndarray, fov: float, aspect: float
) -> tuple[np.ndarray, np.ndarray]:
    """A camera that has what another one sees in the uppermost part of a narrow window, which the panel leaves free.

    Args:
        eye, target: where the other one stands and at what it looks, shape (3,).
        up: direction up, shape (3,).
        fov: vertical field of view [rad].
        aspect: width over height of the window [-].

    Returns:
        Where it stands, and at what it looks.
    """
    away = max(1.0 / FREE, ASPECT / aspect) * (eye - target)
    distance = np.linalg.norm(away)
    upwards = up - (up @ away) * away / distance**2
    height = 2.0 * distance * np.tan(0.5 * fov)
    below = target - 0.5 * (1.0 - FREE) * height * upwards / np.linalg.norm(upwards)
    return below + away, below


def clamped(value: float, ends: tuple[float, float]) -> float:
    """The number between two ends that is nearest to a value."""
    return float(min(max(value, ends[0]), ends[1]))


def make_server(host: str, port: int, token: str) -> Any:
    """A viser server for viewers who know the token, which they cannot make public."""
    import viser

    class Server(viser.ViserServer):
        """A server without viser's tunnel: any viewer could open it, and the whole internet would reach the page."""

        def request_share_url(self, verbose: bool = True) -> None:
            """Refuse: a page has no tunnel."""

    with guarded(Guard(host, token)):
        return Server(host=host, port=port, verbose=False)
