"""Where a page is served: reading HOST:PORT, finding a free port, and who can reach it."""

import ipaddress
import secrets
import socket
from dataclasses import dataclass, replace

from taichisoft.errors import TaichisoftError

HOST, PORT = "127.0.0.1", 8080
PORTS_TRIED = 100
"""Ports that are tried, from the usual one on, where the user named none."""
NOT_ENCRYPTED = "what passes, the token too, is not encrypted: an ssh tunnel is safer"
VALID = "must look like 127.0.0.1:8080 or [::1]:8080, with a port from 0 to 65535 (0 takes any that is free)"


class WebError(TaichisoftError):
    """A web page cannot be served."""


@dataclass(frozen=True)
class Address:
    """A place to listen at.

    Attributes:
        host: name or number of a network interface of this machine.
        port: a port that was free when the address was found.
        token: what a viewer must know; the address of the page ends with it.
    """

    host: str
    port: int
    token: str

    @property
    def url(self) -> str:
        """The page as a browser opens it; an address that stands for all interfaces gets the machine's name."""
        named = {"0.0.0.0": socket.gethostname(), "::": socket.gethostname()}.get(self.host, self.host)
        return f"http://{f'[{named}]' if ':' in named else named}:{self.port}/?token={self.token}"

    @property
    def is_open(self) -> bool:
        """Whether other machines may reach it."""
        return not _is_loopback(self.host)

    def at(self, port: int) -> "Address":
        """The same address with another port."""
        return replace(self, port=port)


def find_address(text: str | None) -> Address:
    """The address of a command line; without one, a free port that only this machine reaches."""
    if text is None:
        for port in range(PORT, PORT + PORTS_TRIED):
            if not _problem(HOST, port):
                return Address(HOST, port, _new_token())
        raise WebError(f"no page: the ports {PORT} to {PORT + PORTS_TRIED - 1} of {HOST} are all taken")
    host, port = _parse(text)
    problem = _problem(host, port)
    if problem:
        raise WebError(f"address {text}: cannot be listened at: {problem}")
    return Address(host, port, _new_token())


def _new_token() -> str:
    return secrets.token_urlsafe(16)


def _parse(text: str) -> tuple[str, int]:
    host, colon, number = text.rpartition(":")
    bracketed = host.startswith("[") and host.endswith("]")
    host = host[1:-1] if bracketed else host
    valid_host = bool(host) and (bracketed or ":" not in host)
    if not (colon and valid_host and number.isascii() and number.isdecimal() and int(number) <= 65535):
        raise WebError(f"address {text}: {VALID}")
    # localhost is the loopback whatever names this system can resolve (RFC 6761, section 6.3).
    return HOST if host == "localhost" else host, int(number)


def _problem(host: str, port: int) -> str:
    """The reason why nothing can listen at an address; empty when something can."""
    try:
        family, kind, protocol, _, place = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as tried:
            tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            tried.bind(place)
            tried.listen()
    except UnicodeError:  # the host cannot be written in the letters of addresses
        return "not a name of a host"
    except OSError as error:
        return error.strerror or str(error)
    return ""


def _is_loopback(host: str) -> bool:
    places = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
    return all(ipaddress.ip_address(str(place[4][0]).partition("%")[0]).is_loopback for place in places)
