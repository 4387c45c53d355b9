"""A page that shows instants of a run or of a recording."""

import hmac
import http
import ipaddress
import logging
import socket
import threading
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np

from taichisoft import Scene
from taichisoft.base import quaternion_from_matrix
from taichisoft.control import KeyEvent
from taichisoft.mechanics import ACTUATOR_KINDS, kind_called
from taichisoft.mesh import split_triangles
from taichisoft.scene import red_green_blue
from taichisoft_outputs.drawing.camera import VERTICAL_ANGLE, PictureCamera, fit_camera, radius_around_mean
from taichisoft_outputs.drawing.colouring import LINE, PLAIN, ColourScale, body_colours, effort_scale
from taichisoft_outputs.drawing.overlay import BODY_AXIS, arrow_colour, as_bytes
from taichisoft_outputs.drawing.stage import square_of_plane
from taichisoft_outputs.drawing.style import BACKGROUND
from taichisoft_outputs.drawing.surface_painter import Section, key_light, split_creases
from taichisoft_outputs.html_template import render
from taichisoft_outputs.web.address import WebError
from taichisoft_outputs.web.curves import Curves
from taichisoft_outputs.web.page_messages import LinesShown, PageInstant, PageScene

# Who may see a page: whoever has its token, and comes from the page itself.
#
# Any website that is open in the same browser can connect to a port of this machine, and by a name of its own that it
# lets point here (DNS rebinding) its requests even look as if they belonged here. So every request must name a host
# that is this machine, a WebSocket must come from the page that it belongs to (RFC 6455, section 10.2), and all must
# know the token: from the printed address, and from then on from a cookie.


class Guard:
    """Looks at every request before the page does.

    Attributes:
        token: what the address of the page ends with.
        installed: whether a server asks it.
    """

    def __init__(self, host: str, token: str):
        """Guard a page that listens at a name or number of this machine."""
        self.token = token
        self.installed = False
        self._names = {"localhost", host.lower(), socket.gethostname().lower()}
        # Where names are not resolved this takes half a minute, for which no request shall wait.
        threading.Thread(target=self._learn_full_name, name="full name", daemon=True).start()

    def answer(self, connection: Any, request: Any) -> Any:
        """The refusal of a request, or the way on for one with the token in its address; None for one that may pass."""
        path, _, query = request.path.partition("?")
        socket_wanted = request.headers.get("Upgrade", "").lower() == "websocket"
        if problem := self._problem(request.headers):
            return connection.respond(http.HTTPStatus.FORBIDDEN, f"{problem}\n")
        cookie = cookie_name(request.headers["Host"])
        in_address = self._is_token(parse_qs(query).get("token", [""])[0])
        if not (in_address or self._is_token(_cookies(request.headers).get(cookie, ""))):
            return connection.respond(
                http.HTTPStatus.FORBIDDEN, "open the address that was printed: it ends with a token\n"
            )
        if in_address and not socket_wanted and path == "/":
            onward = connection.respond(http.HTTPStatus.SEE_OTHER, "")
            onward.headers["Location"] = "/"
            onward.headers["Set-Cookie"] = f"{cookie}={self.token}; Path=/; HttpOnly; SameSite=Lax"
            onward.headers["Referrer-Policy"] = "no-referrer"
            return onward
        return None

    def _learn_full_name(self) -> None:
        self._names |= {socket.getfqdn().lower()}

    def _problem(self, headers: Any) -> str:
        """What is wrong with the Host and the Origin of a request; empty when nothing is."""
        hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
        if len(hosts) != 1 or not self.is_here(hosts[0]):
            return "this is not a name of the machine that serves the page"
        if any(
            origin.lower() not in (f"http://{hosts[0]}".lower(), f"https://{hosts[0]}".lower()) for origin in origins
        ):
            return "the request comes from another website"
        return ""

    def is_here(self, host: str) -> bool:
        """Whether a Host names this machine; numbers do, since a number cannot be made to point elsewhere."""
        try:
            place = urlsplit(f"//{host}")
            name, _ = (place.hostname or "").lower(), place.port
        except ValueError:
            return False
        try:
            ipaddress.ip_address(name.partition("%")[0])
        except ValueError:
            return name in self._names
        return True

    def _is_token(self, text: str) -> bool:
        # What a header has beside ASCII comes as surrogates, which only this way have bytes.
        return hmac.compare_digest(text.encode(errors="surrogateescape"), self.token.encode())


def cookie_name(host: str) -> str:
    """Name of the cookie of the page that a browser calls by a Host.

    Browsers keep cookies by host and not by port (RFC 6265, section 8.5): of several pages, here or at the ends of
    tunnels, each needs a name of its own, and only the port that the browser sees distinguishes them.
    """
    return f"taichisoft-{urlsplit(f'//{host}').port or 80}"


@contextmanager
def guarded(guard: Guard) -> Iterator[None]:
    """Let the server that is started within ask a guard first: viser takes no function for that."""
    import websockets.asyncio.server as servers

    usual = servers.serve

    def serve(*arguments: Any, process_request: Callable[..., Any] | None = None, **named: Any) -> Any:
        def answer(connection: Any, request: Any) -> Any:
            refusal = guard.answer(connection, request)
            return process_request(connection, request) if refusal is None and process_request else refusal

        guard.installed = True
        return usual(*arguments, process_request=answer, logger=CONNECTIONS, **named)

    servers.serve = serve  # type: ignore[assignment,misc]
    try:
        yield
    finally:
        servers.serve = usual  # type: ignore[misc]
    if not guard.installed:
        raise WebError("this version of viser cannot be guarded against other websites; install viser 1.1")


def _is_worth_a_line(record: logging.LogRecord) -> bool:
    """Shorten what the server logs to one line, and leave out requests that are none, which anybody can send."""
    message = record.getMessage()
    if record.exc_info and record.exc_info[1] is not None:
        error = record.exc_info[1]
        record.msg, record.args, record.exc_info = f"web page: {message}: {type(error).__name__}: {error}", (), None
    return not message.startswith("opening handshake failed")


CONNECTIONS = logging.getLogger("taichisoft.web")
CONNECTIONS.addFilter(_is_worth_a_line)


def _cookies(headers: Any) -> dict[str, str]:
    pairs = (part.strip().partition("=") for text in headers.get_all("Cookie") for part in text.split(";"))
    return {name: value for name, _, value in pairs}


# What the colours and arrows of a page mean: bars of efforts of actuators, and the force of the longest arrow.

TEMPLATE = Path(__file__).with_name("scales_shown.html")
GAUGES = Path(__file__).with_name("gauges.html")


class Scales:
    """How far efforts of actuators and contact forces reach so far; scales begin at zero.

    Attributes:
        efforts: colours by value and by kind of actuator; none of a kind as long as all are zero.
        force: the largest contact force [mN].
    """

    def __init__(self) -> None:
        """Begin with zeros alone."""
        self._reach: dict[str, np.ndarray] = {}
        self.efforts: dict[str, ColourScale] = {}
        self.force = 0.0

    def reach_to(self, efforts: Mapping[str, np.ndarray], force: float) -> bool:
        """Widen the scales so that efforts by kind and a force are on them; returns whether one of them is another."""
        before = dict(self.efforts), self.force
        for name, values in efforts.items():
            kind, reach = kind_called(name), _ends(self._reach.get(name, np.zeros(2)), values)
            self._reach[name] = reach
            if (scale := effort_scale(kind, reach)) is not None:
                self.efforts[name] = scale
        self.force = max(self.force, float(force))
        return before != (self.efforts, self.force)

    def html(self, arrow: Sequence[int]) -> str:
        """The scales for the panel, empty where all are zero; `arrow` is the colour of arrows, 3 numbers up to 255."""
        bars = [
            (scale.title, f"{scale.low:g}", f"{scale.high:g}", [_css(np.multiply(255, step)) for step in scale.steps])
            for scale in self.efforts.values()
        ]
        return render(TEMPLATE, bars=bars, force=f"{self.force:.3g}" if self.force else "", arrow=_css(arrow))


def _ends(known: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.array([np.min(values, initial=known[0]), np.max(values, initial=known[1])])


def _css(colour: Sequence[float] | np.ndarray) -> str:
    return "#" + "".join(f"{round(float(part)):02x}" for part in colour)


# The three-dimensional part of a page: bodies, cavities and cables inside them, floor, axes, arrows of forces.

LENGTH_UNIT = 0.01
"""Units of the page in a millimetre: its lights, shadows and camera are made for things of a few units."""

ASPECT = 1.3
"""Width / height of the part of a window that the panel leaves free."""

BACKWARD = 1.35
"""The camera begins so many times further off than the first instant needs, since everything is going to move [-]."""

FLOOR = (0.68, 0.745, 0.815)
"""Red, green and blue of a floor without a colour of its own [-]."""
SILICONE_OPACITY = 0.55

LINE_THICKNESS = 0.013
"""Thickness of cables and other lines, in radii of the scene [-]; they are thinner, but would not be seen."""
ARROW_LENGTH = 0.35
"""Length of the arrow of the largest force so far, in radii of the scene [-]; the others are in proportion."""
SMALLEST_ARROW = 0.03
"""Forces below this part of the largest one so far are not drawn [-]."""
CORNER_AXIS = 0.2
"""Length of the scene's axes, in radii of the scene [-]."""
BESIDE = 0.55
"""Distance of the scene's axes from the middle, both to the left and towards the camera, in radii of the scene [-]."""
OUT_OF_BODY = 1.2
"""Length of the axes of rigid bodies, in their radii [-]."""
LIGHT, GROUND = 2.0, (150, 150, 150)
"""Strength of the two lights, in viser's unit, and colour of the light from below: a floor has about its own colour."""


class SceneView:
    """Draws instants into the scene of a viser server; what did not move is not sent again.

    Attributes:
        eye: where viewers look from at first [mm], shape (3,).
    """

    def __init__(self, server: Any, content: PageScene, first: PageInstant):
        """Put everything where the first instant has it, and the camera where it sees that."""
        self._server = server
        self._scales, self._scales_shown = Scales(), None
        self._actuators = content.actuators
        at_first = [surface.vertices(first.poses) for surface in content.surfaces]
        bodies = [v for s, v in zip(content.surfaces, at_first, strict=True) if s.kind in ("soft", "rigid")]
        points = np.vstack(bodies) if bodies else np.vstack([np.zeros((1, 3)), *at_first])
        points = np.vstack([points, *(lines.ends.reshape(-1, 3) for lines in first.lines.values())])
        self._radius = max(radius_around_mean(points), 1.0)
        server.scene.set_up_direction(content.scene.up)
        self._set_lights(content.scene)
        self._set_camera(points, content.scene)
        background = content.scene.appearance.background
        self._set_background(background)
        self._own_colours = body_colours(content.scene)
        behind = [
            np.array(BACKGROUND if background is None else red_green_blue(background)),
            *self._own_colours.values(),
        ]
        self._force_colour = as_bytes(arrow_colour(behind))
        self._surfaces, self._cut = content.surfaces, frozenset[str]()
        self._sources, self._triangles, self._meshes, self._depths = [], [], [], []
        for surface, vertices in zip(content.surfaces, at_first, strict=True):
            source, triangles = split_creases(vertices, surface.triangles)
            self._sources.append(source)
            self._triangles.append(triangles)
            seen_through = _opacity(surface.kind) is not None
            self._depths.append(self._add_depth(surface.name, vertices[source], triangles) if seen_through else None)
            self._meshes.append(self._add(surface.name, vertices[source], triangles, surface.kind))
        self._walls = {}
        for kind in ACTUATOR_KINDS:
            if kind.drawn == "walls":
                named = zip(content.surfaces, self._meshes, strict=True)
                meshes = {surface.name: mesh for surface, mesh in named if surface.kind == kind.name}
                self._walls[kind.name] = [meshes.get(name) for name in content.actuators.names_of(kind)]
        if content.scene.appearance.frame:
            self._add_axes(points, content.scene.up)
        rigid = {s.name: v for s, v in zip(content.surfaces, at_first, strict=True) if s.kind == "rigid"}
        self._axes = [
            (axes, self._add_frame(f"/axes of {name}", self._length_of_axes(rigid.get(name))))
            for name, axes in content.axes.items()
        ]
        for plane in content.planes:
            self._add(plane.name, *square_of_plane(plane, points, []), "floor")
        self._lines = {
            name: self._add_lines(f"/{name} lines", lines.ends)
            for name, lines in first.lines.items()
            if len(lines.ends)
        }
        self._arrows = server.scene.add_arrows(
            "/contact forces",
            np.zeros((1, 2, 3)),
            self._force_colour,
            shaft_radius=0.009 * self._radius * LENGTH_UNIT,
            head_radius=0.024 * self._radius * LENGTH_UNIT,
            head_length=0.06 * self._radius * LENGTH_UNIT,
            visible=False,
        )

    def show(self, instant: PageInstant, section: Section | None = None) -> None:
        """Move everything to where an instant has it, cut open by a section."""
        strength = np.linalg.norm(instant.contact_forces, axis=1)
        walls = [kind for kind in ACTUATOR_KINDS if kind.drawn == "walls"]
        efforts = {kind.name: self._actuators.of(kind, instant.plotted) for kind in walls}
        efforts |= {name: lines.efforts for name, lines in instant.lines.items()}
        self.reach_to(efforts, strength.max(initial=0.0))
        with self._server.atomic():
            for number, surface in enumerate(self._surfaces):
                self._show_surface(number, surface.vertices(instant.poses), section)
            self._cut = frozenset[str]() if section is None else section.names
            for name, meshes in self._walls.items():
                self._show_walls(name, meshes, efforts[name])
            for name, handle in self._lines.items():
                self._show_lines(name, handle, instant.lines[name])
            self._show_forces(instant.contact_points, instant.contact_forces, strength)
            for axes, handle in self._axes:
                origin, *directions = axes.place(instant.poses)
                handle.position = origin * LENGTH_UNIT
                handle.wxyz = quaternion_from_matrix(np.transpose(directions))

    def let_pull(self, names: Collection[str], send: Callable[[KeyEvent], None]) -> None:
        """Have bodies pulled by a pointer with the shift key, which sends where it is."""
        for surface, mesh in zip(self._surfaces, self._meshes, strict=True):
            if surface.kind in ("soft", "rigid") and surface.name in names:
                mesh.on_drag("left", modifier="shift")(partial(_send_pointer, surface.name, send))

    def put_scales(self, handle: Any) -> None:
        """Keep an HTML element of the panel up to date with what colours and arrows mean."""
        self._scales_shown = handle

    def reach_to(self, efforts: Mapping[str, np.ndarray], force: float) -> None:
        """Let the scales reach to efforts by kind of actuator, such as pressures [kPa], and to a contact force [mN]."""
        if self._scales.reach_to(efforts, force) and self._scales_shown is not None:
            self._scales_shown.content = self._scales.html(self._force_colour)

    def _show_surface(self, number: int, vertices: np.ndarray, section: Section | None) -> None:
        """Where it is cut it has other triangles in each instant, and silicone cannot be seen through."""
        surface, mesh, depth = self._surfaces[number], self._meshes[number], self._depths[number]
        is_cut = section is not None and surface.name in section.names
        if depth is not None:
            depth.visible = not is_cut
        if section is not None and is_cut:
            corners = vertices[surface.triangles]
            kept, _, _ = split_triangles(corners, section.plane.height(corners))
            kept = kept[:, ::-1] if surface.name in section.hollow else kept
            shown = np.concatenate([kept, section.caps.get(surface.name, kept[:0])[..., :3]])
            mesh.visible = len(shown) > 0
            if mesh.visible:
                mesh.vertices = (shown.reshape(-1, 3) * LENGTH_UNIT).astype(np.float32)
                mesh.faces = np.arange(3 * len(shown), dtype=np.uint32).reshape(-1, 3)
                mesh.opacity = None
            return
        for one in filter(None, (depth, mesh)):
            one.vertices = (vertices[self._sources[number]] * LENGTH_UNIT).astype(np.float32)
        if surface.name in self._cut:
            mesh.faces = self._triangles[number].astype(np.uint32)
            mesh.opacity, mesh.visible = _opacity(surface.kind), True

    def _show_walls(self, kind: str, meshes: Sequence[Any], efforts: np.ndarray) -> None:
        if kind in self._scales.efforts:
            for mesh, colour in zip(meshes, self._scales.efforts[kind].colours(efforts), strict=True):
                if mesh is not None and mesh.color != as_bytes(colour):
                    mesh.color = as_bytes(colour)

    def _show_lines(self, kind: str, handle: Any, lines: LinesShown) -> None:
        handle.points = (lines.ends * LENGTH_UNIT).astype(np.float32)
        if kind in self._scales.efforts:
            colours = np.rint(255 * self._scales.efforts[kind].colours(lines.efforts)).astype(np.uint8)
            handle.colors = np.repeat(colours[:, None], 2, axis=1)

    def _show_forces(self, points: np.ndarray, forces: np.ndarray, strength: np.ndarray) -> None:
        """Each arrow ends where its force acts: its shaft stands in the first body, which is translucent if soft."""
        drawn = strength > SMALLEST_ARROW * self._scales.force
        self._arrows.visible = bool(drawn.any())
        if drawn.any():
            shafts = forces[drawn] * (ARROW_LENGTH * self._radius / self._scales.force)
            ends = np.stack([points[drawn] - shafts, points[drawn]], axis=1)
            self._arrows.points = (ends * LENGTH_UNIT).astype(np.float32)

    def _add(self, name: str, vertices: np.ndarray, triangles: np.ndarray, kind: str) -> Any:
        own = self._own_colours.get(name)
        return self._server.scene.add_mesh_simple(
            f"/{name}",
            vertices * LENGTH_UNIT,
            triangles,
            color=as_bytes((PLAIN | {"floor": FLOOR})[kind] if own is None else own),
            opacity=_opacity(kind),
            cast_shadow=kind in ("soft", "rigid"),
            receive_shadow=kind in ("floor", "obstacle"),
        )

    def _add_depth(self, name: str, vertices: np.ndarray, triangles: np.ndarray) -> Any:
        """An invisible mesh before one that is seen through, so that of the latter the nearest layer alone is drawn.

        three.js draws the triangles of a mesh in their order, and a near one hides only farther ones that come later:
        of the walls of a gap some triangles would be seen, and others not.
        """
        return self._server.scene.add_mesh_simple(
            f"/{name} depth", vertices * LENGTH_UNIT, triangles, opacity=0.0, cast_shadow=False, receive_shadow=False
        )

    def _add_frame(self, name: str, length: float, **place: Any) -> Any:
        """Arrows in red, green and blue for x, y and z, of a length in radii of the scene."""
        shaft = 0.012 * self._radius * LENGTH_UNIT
        return self._server.scene.add_frame(
            name, axes_length=length * self._radius * LENGTH_UNIT, axes_radius=shaft, origin_radius=shaft, **place
        )

    def _length_of_axes(self, vertices: np.ndarray | None) -> float:
        """Length of a body's axes, in radii of the scene: they must come out of a rigid one, which hides the rest."""
        if vertices is None:
            return BODY_AXIS
        return max(BODY_AXIS, OUT_OF_BODY * radius_around_mean(vertices) / self._radius)

    def _add_axes(self, points: np.ndarray, up: np.ndarray) -> None:
        """The directions of x, y and z, with their names, beside the bodies: a page has no corner that stands still."""
        right, _, backward = fit_camera(points, up, "iso", ASPECT).axes
        before = backward - (backward @ up) * up - right
        middle = points.mean(axis=0)
        corner = middle + BESIDE * self._radius * before + ((points @ up).min() - middle @ up) * up
        self._add_frame("/axes", CORNER_AXIS, position=corner * LENGTH_UNIT)
        for name, direction in zip("xyz", np.eye(3), strict=True):
            tip = corner + 1.15 * CORNER_AXIS * self._radius * direction
            self._server.scene.add_label(
                f"/axes/name of {name}", name, position=(tip - corner) * LENGTH_UNIT, anchor="center-center"
            )

    def _add_lines(self, name: str, ends: np.ndarray) -> Any:
        return self._server.scene.add_line_segments(
            name,
            ends * LENGTH_UNIT,
            np.tile(np.array(LINE[0]), (len(ends), 2, 1)),
            thickness=LINE_THICKNESS * self._radius * LENGTH_UNIT,
        )

    def _set_lights(self, scene: Scene) -> None:
        """Light from where that of pictures comes from; viser's own is so bright that colours turn pale."""
        self._server.scene.configure_default_lights(enabled=False)
        self._server.scene.configure_environment_map(None)
        self._server.scene.add_light_hemisphere("/light from all around", ground_color=GROUND, intensity=LIGHT)
        key, shadows = 10.0 * key_light(scene), scene.appearance.shadows
        self._server.scene.add_light_directional("/key light", position=key, intensity=LIGHT, cast_shadow=shadows)

    def _set_background(self, colour: str | None) -> None:
        if colour is not None:
            # viser has no colour behind a scene, but a picture, which it stretches; JPEG would change its colour.
            pixel = np.array([[as_bytes(red_green_blue(colour))]], dtype=np.uint8)
            self._server.scene.set_background_image(pixel, format="png")

    def _set_camera(self, points: np.ndarray, scene: Scene) -> None:
        camera, eye, target = fit_camera(points, scene.up, "iso", ASPECT), scene.appearance.eye, scene.appearance.target
        away = BACKWARD * (camera.eye - camera.target)
        if eye is not None:
            target_point = camera.target if target is None else np.array(target)
            camera = PictureCamera(np.array(eye), target_point, scene.up)
            away = camera.eye - camera.target
        self.eye = camera.target + away
        initial = self._server.initial_camera
        initial.position = self.eye * LENGTH_UNIT
        initial.look_at = camera.target * LENGTH_UNIT
        initial.up = camera.up
        initial.fov = float(np.radians(VERTICAL_ANGLE))


async def _send_pointer(body: str, send: Callable[[KeyEvent], None], event: Any) -> None:
    if event.phase == "start":
        send(KeyEvent(body, pointer=_millimetres(event.start_position)))
    send(KeyEvent(body, pointer=() if event.phase == "end" else _millimetres(event.end_position)))


def _millimetres(place: Sequence[float]) -> tuple[float, ...]:
    return tuple(float(one) / LENGTH_UNIT for one in place)


def _opacity(kind: str) -> float | None:
    return SILICONE_OPACITY if kind == "soft" else None


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
# viser has one theme for all viewers, which does not follow what each has chosen in the browser.
FOLLOW_DARK_MODE = """
<style>[data-mantine-color-scheme=dark] canvas[data-engine] { background: #141414 }</style>
<img hidden src="data:," onerror="
const dark = matchMedia('(prefers-color-scheme: dark)'), root = document.documentElement;
const name = 'data-mantine-color-scheme', wanted = () => dark.matches ? 'dark' : 'light';
const follow = () => { if (root.getAttribute(name) !== wanted()) root.setAttribute(name, wanted()); };
dark.onchange = follow;
new MutationObserver(follow).observe(root, {attributeFilter: [name]});
follow()">"""


class Page:
    """A server with the scene, a line of text and the plots.

    Attributes:
        server: server of viser, to which controls can be added.
        port: port at which it listens.
    """

    def __init__(self, host: str, port: int, token: str, content: PageScene, first: PageInstant):
        """Serve viewers who know the token, at an address of `find_address`."""
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
        gui.add_html(FOLLOW_DARK_MODE)
        self._actuators = content.actuators
        self._text = gui.add_markdown("", order=0.0)
        self._gauges = gui.add_html("", order=0.2)
        self.view.put_scales(gui.add_html("", order=0.5))
        with gui.add_folder("plots", order=100.0):
            self.curves = Curves(gui, content)
        self.server.on_client_connect(self._fit_window)

    def set_status(self, text: str, instant: PageInstant) -> None:
        """Put a line of Markdown above everything, and the efforts of actuators, to be read from some metres."""
        self._text.content = text
        gauges = [
            (f"{name.removesuffix(f'.{kind.name}')} [{kind.effort.unit}]", f"{value:z.{kind.effort.digits}f}")
            for kind in ACTUATOR_KINDS
            for name, value in zip(
                self._actuators.names_of(kind), self._actuators.of(kind, instant.plotted), strict=True
            )
        ]
        self._gauges.content = render(GAUGES, gauges=gauges) if gauges else ""

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
