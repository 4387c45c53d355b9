"""Where a page is served, and who sees it: those who open its printed address, and nobody else."""

import http.client
import socket
import threading
import time
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlsplit

import pytest

from taichisoft_outputs.web import address as module
from taichisoft_outputs.web.address import Address, WebError, find_address
from taichisoft_outputs.web.page import Guard, guarded, make_server

pytest.importorskip("viser", reason="needs the extra 'web'")

FOREIGN_HOSTS = (
    "evil.example", "evil.example:{port}", "localhost.evil.example", "127.0.0.1.evil.example:{port}", "",
    "127.0.0.1@evil.example", "evil.example#127.0.0.1", "[::1", "localhost:x", "127.0.0.1:99999",
)  # fmt: skip
FOREIGN_ORIGINS = (
    "http://evil.example", "https://evil.example", "null", "http://127.0.0.1", "http://127.0.0.1:1",
    "http://localhost:{port}", "http://127.0.0.1:{port}.evil.example", "http://evil.example:{port}", "file://",
    "http://127.0.0.1:{port}@evil.example", "ftp://127.0.0.1:{port}", "http://[",
)  # fmt: skip


@pytest.fixture(scope="module")
def address() -> Iterator[Address]:
    """Of a page without anything on it."""
    found = find_address("127.0.0.1:0")
    server = make_server(found.host, found.port, found.token)
    yield found.at(server.get_port())
    server.stop()


def status(address: Address, path: str = "/", **headers: str | None) -> Any:
    """The answer to a request; `Host` and a WebSocket's headers as a browser sends them, unless others are given."""
    connection = http.client.HTTPConnection(address.host, address.port, timeout=20)
    connection.putrequest("GET", path, skip_host=True)
    sent = {"Host": f"{address.host}:{address.port}"} | headers
    for name, value in sent.items():
        if value is not None:
            connection.putheader(name.replace("_", "-"), value)
    connection.endheaders()
    answer = connection.getresponse()
    connection.close()
    return answer


def websocket(address: Address, path: str, **headers: str | None) -> int:
    """The status of the answer to a request for a WebSocket; 101 lets it in."""
    wanted = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec_WebSocket_Version": "13"}
    key = {"Sec_WebSocket_Key": "MDEyMzQ1Njc4OWFiY2RlZg==", "Sec_WebSocket_Protocol": "viser-v1.1.1"}
    return int(status(address, path, **wanted, **key, **headers).status)


def test_the_printed_address_opens_the_page(address: Address) -> None:
    """As a browser does it: the address, then what it leads to, then the WebSocket from there."""
    onward = status(address, "/?" + urlsplit(address.url).query)
    assert (onward.status, onward.headers["Location"]) == (303, "/")
    cookie = onward.headers["Set-Cookie"].partition(";")[0]
    assert "HttpOnly" in onward.headers["Set-Cookie"]
    page = status(address, "/", Cookie=f"other=1; {cookie}")
    assert page.status == 200 and page.headers["Content-Type"].startswith("text/html")
    origin = f"http://{address.host}:{address.port}"
    assert websocket(address, "/", Cookie=cookie, Origin=origin) == 101


@pytest.mark.parametrize("host", ["localhost:9000", "127.0.0.1:9000", "[::1]:9000"])
def test_a_page_at_the_end_of_an_ssh_tunnel_is_the_same(address: Address, host: str) -> None:
    """`ssh -L 9000:127.0.0.1:PORT` gives it another port, and a browser may call it by another name."""
    query = "/?" + urlsplit(address.url).query
    cookie = status(address, query, Host=host).headers["Set-Cookie"].partition(";")[0]
    assert websocket(address, "/", Host=host, Cookie=cookie, Origin=f"http://{host}") == 101


def test_two_pages_keep_their_own_cookies(address: Address) -> None:
    """Two tunnels, from ports 9000 and 9001 of one machine to the same port of two others."""
    query = "/?" + urlsplit(address.url).query
    cookies = [status(address, query, Host=f"localhost:{port}").headers["Set-Cookie"] for port in (9000, 9001)]
    first, second = (cookie.partition("=")[0] for cookie in cookies)
    assert first != second
    of_another = f"{second}=another-token; {first}={address.token}"
    assert status(address, "/", Host="localhost:9000", Cookie=of_another).status == 200
    assert status(address, "/", Host="localhost:9001", Cookie=of_another).status == 403


def test_a_page_does_not_wait_for_the_full_name_of_its_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    asked, answered = threading.Event(), threading.Event()

    def slow_name() -> str:
        asked.set()
        assert answered.wait(20.0)
        return "robot.laboratory.example"

    monkeypatch.setattr(socket, "getfqdn", slow_name)
    guard = Guard("127.0.0.1", "token")
    assert asked.wait(20.0)
    assert guard.is_here("127.0.0.1:8080") and not guard.is_here("robot.laboratory.example:8080")
    answered.set()
    while not guard.is_here("robot.laboratory.example:8080"):
        time.sleep(0.01)


@pytest.mark.parametrize("path", ["/", "/index.html", "/?token=", "/?token=wrong", "/?token=wrong&token={token}"])
def test_without_the_right_token_there_is_no_page(address: Address, path: str) -> None:
    path = path.format(token=address.token)
    assert status(address, path).status == 403
    assert websocket(address, path) == 403
    assert websocket(address, path, Cookie=f"taichisoft-{address.port}=wrong") == 403


@pytest.mark.parametrize(("path", "cookie"), [("//[", "x"), ("/?token=\xff", "x"), ("/", "\xff"), ("/", "=;; =")])
def test_nonsense_is_refused_like_a_wrong_token(address: Address, path: str, cookie: str) -> None:
    """And is no error of the server, which would write it and its cause into the user's terminal."""
    with socket.create_connection((address.host, address.port), timeout=20) as connection:
        named = f"Host: localhost\r\nCookie: taichisoft-{address.port}={cookie}"
        connection.sendall(f"GET {path} HTTP/1.1\r\n{named}\r\n\r\n".encode("latin-1"))
        assert connection.recv(1000).startswith(b"HTTP/1.1 403 ")


def test_nonsense_leaves_no_traceback_on_the_terminal(address: Address, caplog: pytest.LogCaptureFixture) -> None:
    """No HTTP, half a request, a page that nobody waits for; what is no message of a viewer is worth one line."""
    named = f"Host: localhost:{address.port}\r\nCookie: taichisoft-{address.port}={address.token}\r\n"
    page = f"GET / HTTP/1.1\r\n{named}\r\n".encode()
    for sent in (b"", b"\xff\r\n\r\n", b"GET / HT", b"POST / HTTP/1.1\r\n\r\n", page):
        with socket.create_connection((address.host, address.port), timeout=20) as connection:
            connection.sendall(sent)
    client = pytest.importorskip("websockets.sync.client")
    own = pytest.importorskip("viser").__version__
    origin = f"http://{address.host}:{address.port}"
    with client.connect(
        address.url.replace("http:", "ws:"), origin=origin, subprotocols=[f"viser-v{own}"], proxy=None
    ) as viewer:
        viewer.send("no message")
        with pytest.raises(Exception, match="1011"):
            while True:
                viewer.recv(timeout=20)
    (record,) = caplog.records
    assert record.getMessage().startswith("web page: connection handler failed: ") and record.exc_info is None


@pytest.mark.parametrize("host", FOREIGN_HOSTS)
def test_another_name_is_refused_even_with_the_token(address: Address, host: str) -> None:
    """DNS rebinding: a website lets its own name point to this machine."""
    host = host.format(port=address.port)
    query = "/?" + urlsplit(address.url).query
    assert status(address, query, Host=host).status == 403
    assert websocket(address, query, Host=host, Origin=f"http://{host}") == 403


@pytest.mark.parametrize("origin", FOREIGN_ORIGINS)
def test_another_website_is_refused_even_with_the_token(address: Address, origin: str) -> None:
    """A browser that has the cookie sends it along with what other websites ask for."""
    origin = origin.format(port=address.port)
    assert websocket(address, "/?" + urlsplit(address.url).query, Origin=origin) == 403
    assert websocket(address, "/", Cookie=f"taichisoft-{address.port}={address.token}", Origin=origin) == 403


def test_a_viser_that_serves_in_another_way_is_refused() -> None:
    with pytest.raises(WebError, match="cannot be guarded against other websites"), guarded(Guard("localhost", "t")):
        threading.Thread(target=lambda: None).start()


# Addresses.


def test_without_address_the_next_free_port_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        monkeypatch.setattr(module, "PORT", port)
        found = find_address(None)
        assert found.host == "127.0.0.1" and port < found.port < port + module.PORTS_TRIED
        assert found.url == f"http://127.0.0.1:{found.port}/?token={found.token}"
        monkeypatch.setattr(module, "PORTS_TRIED", 1)
        with pytest.raises(WebError, match=rf"the ports {port} to {port} of 127\.0\.0\.1 are all taken"):
            find_address(None)
        with pytest.raises(WebError, match=rf"^address 127\.0\.0\.1:{port}: cannot be listened at: "):
            find_address(f"127.0.0.1:{port}")


@pytest.mark.parametrize(
    ("text", "is_open"), [("127.0.0.1:0", False), ("localhost:0", False), ("127.0.0.9:0", False), ("0.0.0.0:0", True)]
)
def test_every_page_has_a_token_that_nobody_guesses(text: str, is_open: bool) -> None:
    one, other = find_address(text), find_address(text)
    assert len(one.token) >= 20 and one.token != other.token
    assert one.is_open == is_open


def test_an_open_address_shows_the_machines_name() -> None:
    found = find_address("0.0.0.0:0")
    assert found.at(8090).url == f"http://{socket.gethostname()}:8090/?token={found.token}"


@pytest.mark.parametrize(
    "text", ["", "8080", ":8080", "127.0.0.1", "127.0.0.1:", "localhost:x", "localhost:65536", "::1:80"]
)
def test_what_is_no_address_is_refused_with_what_would_be(text: str) -> None:
    with pytest.raises(WebError, match=r"must look like 127\.0\.0\.1:8080"):
        find_address(text)


def test_an_address_of_another_machine_is_refused() -> None:
    with pytest.raises(WebError, match=r"^address 192\.0\.2\.1:8080: cannot be listened at: "):
        find_address("192.0.2.1:8080")
