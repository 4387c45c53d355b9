"""A page that shows frames, whichever they come from."""

from typing import Any

from taichisoft_plugins.web.curves import Curves
from taichisoft_plugins.web.errors import WebError
from taichisoft_plugins.web.frame import Cast, Frame
from taichisoft_plugins.web.scene_view import SceneView

# A browser moves its camera by letters and arrows that steer the gripper here. Its handler sits behind those of the
# hotkeys, so that a key which goes no further than they do turns the gripper and not the picture.
KEEP_KEYS_FROM_CAMERA = (
    '<img hidden src="data:," onerror="document.documentElement.addEventListener('
    "'keydown', event => event.stopPropagation())\">"
)


class Page:
    """A server with the scene, a line of text and the plots.

    Attributes:
        server: of viser, for whoever adds controls.
        port: it listens there.
        view: the scene.
        curves: the plots.
    """

    def __init__(self, host: str, port: int, cast: Cast, first: Frame):
        """Serve; the address must be one that `find_address` gave.

        Raises:
            WebError: the port was taken in the meantime.
        """
        self.server = make_server(host, port)
        self.port = self.server.get_port()
        if port and self.port != port:
            self.server.stop()
            raise WebError(f"port {port} of {host} is taken")
        self.view = SceneView(self.server, cast, first)
        gui = self.server.gui
        gui.set_panel_label(cast.title or "taichisoft")
        gui.main_panel.dock_right()
        gui.configure_theme(control_width="medium", show_logo=False, show_share_button=False)
        self._text = gui.add_markdown("", order=0.0)
        with gui.add_folder("plots", order=100.0):
            self.curves = Curves(gui, cast)

    def say(self, text: str) -> None:
        """Put a line of Markdown above everything."""
        self._text.content = text


def make_server(host: str, port: int) -> Any:
    """A viser server that cannot be made public by its viewers."""
    import viser

    class Server(viser.ViserServer):
        """Any viewer may ask viser for a tunnel through which the whole internet reaches the page."""

        def request_share_url(self, verbose: bool = True) -> None:
            """There is none."""

    return Server(host=host, port=port, verbose=False)
