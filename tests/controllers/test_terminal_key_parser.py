"""What terminals send becomes key events, however it is cut into pieces; nothing that they send is misread as Esc."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taichisoft import KeyEvent
from taichisoft_controllers.terminal_keys import KeyParser

SENT = [
    # characters
    (b"+", ["+"]),
    (b"aQ?=0", ["a", "Q", "?", "=", "0"]),
    ("é€😀".encode(), ["é", "€", "😀"]),
    (b" \r\n\t\x7f\b", ["space", "enter", "enter", "tab", "backspace", "backspace"]),
    # control codes
    (b"\x01\x11\x03", ["Ctrl+a", "Ctrl+q", "Ctrl+c"]),
    (b"\x1f\x00\x1d", ["Ctrl+-", "Ctrl+space", "Ctrl+]"]),
    # arrows: CSI, SS3, with Ctrl in xterm, in old terminals, in rxvt; with shift, with the number lock of kitty
    (b"\x1b[A\x1b[B\x1b[C\x1b[D", ["up", "down", "right", "left"]),
    (b"\x1bOA\x1bOB\x1bOC\x1bOD", ["up", "down", "right", "left"]),
    (b"\x1b[1;5A\x1b[1;5D", ["Ctrl+up", "Ctrl+left"]),
    (b"\x1bO5C", ["Ctrl+right"]),
    (b"\x1bOb\x1b[b", ["Ctrl+down", "down"]),
    (b"\x1b[1;2A\x1b[1;6B\x1b[1;129C", ["up", "Ctrl+down", "right"]),
    # keys as numbers, and the keypad as an application
    (b"\x1b[43;5u\x1b[45;5u\x1b[97;5u\x1b[27u", ["Ctrl++", "Ctrl+-", "Ctrl+a", "escape"]),
    (b"\x1b[27;5;43~\x1b[27;6;43~", ["Ctrl++", "Ctrl++"]),
    (b"\x1b[97:65;5:1u", ["Ctrl+a"]),
    (b"\x1bOk\x1bOm\x1bOp\x1bOM", ["+", "-", "0", "enter"]),
    # no key of ours: function keys, Alt, focus, paste, mouse, replies, what is not UTF-8
    (b"\x1bOP\x1b[15~\x1b[[A\x1b[3~\x1b[H\x1b[I\x1b[200~\x1b[<0;3;4M\x1b[?62;c\x1b[24;80R", []),
    (b"\x1ba\x1b[1;3A\x1b\x1b[A\x1b[97;3u\x1b[1;9A", []),
    (b"\xff\xc3\x28", ["("]),
    (b"\x1b[99999999999;5u\x1b[1114112u\x1b[55296u\x1b[1;0A", []),
]


def names(events: list[KeyEvent]) -> list[str]:
    return [str(event) for event in events]


@pytest.mark.parametrize(("sent", "keys"), SENT)
def test_what_terminals_send(sent: bytes, keys: list[str]) -> None:
    parser = KeyParser()
    assert names(parser.feed(sent)) == keys
    assert not parser.is_waiting


@given(st.lists(st.sampled_from(SENT), min_size=1, max_size=6), st.data())
def test_cuts_change_nothing(sent: list[tuple[bytes, list[str]]], data: st.DataObject) -> None:
    """Over a network a sequence may arrive in two pieces."""
    stream = b"".join(piece for piece, _ in sent)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=5)))
    parser = KeyParser()
    events = [
        event
        for start, stop in zip([0, *cuts], [*cuts, len(stream)], strict=True)
        for event in parser.feed(stream[start:stop])
    ]
    assert names(events) == [key for _, keys in sent for key in keys]


@given(
    st.lists(st.binary(max_size=12) | st.from_regex(rb"\x1b[\[O]?[0-9;]{0,80}[A-Za-z~]?", fullmatch=True), max_size=6)
)
def test_nothing_can_confuse_it_for_long(pieces: list[bytes]) -> None:
    """After any bytes and a moment without more, the next keys are understood."""
    parser = KeyParser()
    for piece in pieces:
        parser.feed(piece)
    parser.flush()
    parser.feed(b"  ")  # ends what UTF-8 may wait for
    assert names(parser.feed(b"\x1b[1;5Aq")) == ["Ctrl+up", "q"]


@pytest.mark.parametrize("sent", [b"\x1b", b"\x1b\x1b"])
def test_an_escape_alone_is_a_key_once_nothing_follows(sent: bytes) -> None:
    parser = KeyParser()
    assert parser.feed(sent) == []
    assert parser.is_waiting
    assert names(parser.flush()) == ["escape"]
    assert not parser.is_waiting


def test_a_held_escape_needs_no_pause() -> None:
    assert names(KeyParser().feed(4 * b"\x1b")) == ["escape", "escape"]


@pytest.mark.parametrize("sent", [b"\x1b[", b"\x1b[1;5", b"\x1bO", b"\x1b\x1b[", b"\xc3"])
def test_the_rest_of_a_sequence_that_never_comes_is_no_escape(sent: bytes) -> None:
    parser = KeyParser()
    assert parser.feed(sent) == []
    assert parser.flush() == []
