"""Who may see a page: whoever has its token, and comes from the page itself.

Any website that is open in the same browser can connect to a port of this machine, and by a name of its own that it
lets point here (DNS rebinding) its requests even look as if they belonged here. So every request must name a host that
is this machine, a WebSocket must come from the page that it belongs to (RFC 6455, section 10.2), and all must know the
token: from the printed address, and from then on from a cookie.
"""

import hmac
import http
import ipaddress
import logging
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import parse_qs, urlsplit

from taichisoft_outputs.web.address import WebError


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
    """Let the server that is started within ask a guard first: viser takes no function for that.

    Raises:
        WebError: this version of viser serves in another way, and would serve everybody.
    """
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
