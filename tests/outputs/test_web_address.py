"""Where a page listens: what is valid, what is free, and who needs a token."""

import socket

import pytest

from taichisoft_outputs.web import address as module
from taichisoft_outputs.web.address import WebError, find_address


def test_without_an_address_the_next_free_port_of_this_machine_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_an_address_of_all_interfaces_is_shown_with_the_name_of_the_machine() -> None:
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
