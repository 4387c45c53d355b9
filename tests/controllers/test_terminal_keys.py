"""Keys from a terminal: parsed, and handed to a run until it ends."""

import os
import pty
import shutil
import signal
import subprocess
import sys
import termios
import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from terminal import Terminal, line, python, terminal

from taichisoft import KeyEvent
from taichisoft.errors import ControllerFailed
from taichisoft_controllers import terminal_keys, terminal_mode
from taichisoft_controllers.terminal_keys import KeyParser

PROGRAM = python(Path(__file__).with_name("keys_shown.py"))


def started(screen: Terminal) -> int:
    """Wait until the program reads keys; returns its process number.

    The whole line must be there: a program that is still about to end it when the terminal goes fails to write.
    """
    number = int(screen.wait_for(r"process (\d+) runs\r\n")[1])
    screen.wait_until(lambda: screen.is_for_keys)
    return number


def test_a_key_arrives_at_once_and_is_not_echoed(tmp_path: Path) -> None:
    """Ctrl and s or q would otherwise stop and start the output of the terminal."""
    keys = {
        "+": "<+>",
        "é": "<é>",
        "\x1b[A": "<up>",
        "\x1b[1;5C": "<Ctrl+right>",
        "\x01": "<Ctrl+a>",
        "\x13": "<Ctrl+s>",
        "\x11": "<Ctrl+q>",
        "\r": "<enter>",
        "\x1b": "<escape>",
    }
    with terminal(*PROGRAM, folder=tmp_path) as screen:
        started(screen)
        for typed, key in keys.items():
            screen.type(typed)
            screen.wait_for("<(.*?)>")
            assert (screen.before.strip(), screen.after) == ("", key)


@pytest.mark.parametrize(
    ("typed", "code"),
    [
        pytest.param("\x1b", 0, id="regular end"),
        pytest.param("\x03", 0, id="Ctrl and c"),
        pytest.param("\x1b[99;5u", 0, id="Ctrl and c as a number"),
        pytest.param("e", 1, id="exception"),
        pytest.param("f", 1, id="end not called"),
        pytest.param("x", 3, id="atexit not called"),
    ],
)
def test_the_terminal_is_put_back_after_every_end(tmp_path: Path, typed: str, code: int) -> None:
    with terminal(*PROGRAM, folder=tmp_path) as screen:
        started(screen)
        screen.type(typed)
        screen.wait_for(f"shell: exit code {code}")
        screen.wait_until(lambda: screen.is_as_before)


@pytest.mark.parametrize(("typed", "code"), [("\x1b", 0), ("f", 1)])
def test_without_the_watching_child_the_process_does_it_alone(tmp_path: Path, typed: str, code: int) -> None:
    """A machine may have no room for another process."""
    with terminal(*PROGRAM, "alone", folder=tmp_path) as screen:
        started(screen)
        screen.type(typed)
        screen.wait_for(f"shell: exit code {code}")
        assert screen.is_as_before


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL, signal.SIGSEGV])
def test_the_terminal_is_put_back_when_the_process_is_killed(tmp_path: Path, number: signal.Signals) -> None:
    """The program handles none of these signals; the watching child is what remains."""
    with terminal(*PROGRAM, folder=tmp_path) as screen:
        os.kill(started(screen), number)
        screen.wait_for(f"shell: exit code {128 + number}")
        screen.wait_until(lambda: screen.is_as_before)


@pytest.mark.parametrize("taken_over", [False, True])
def test_watching_child_leaves_other_modes_alone(taken_over: bool) -> None:
    """A shell's line editor may have the terminal before the child notices the end."""
    master, slave = pty.openpty()
    own = termios.tcgetattr(slave)
    changed = [*own[:3], own[3] & ~termios.ICANON, *own[4:]]
    present = [*own[:3], own[3] & ~(termios.ICANON | termios.ECHO), *own[4:]] if taken_over else changed
    termios.tcsetattr(slave, termios.TCSANOW, present)
    try:
        subprocess.run(
            [sys.executable, terminal_mode.__file__, str(slave), repr(own), repr(changed)],
            stdin=subprocess.DEVNULL,  # ends at once
            pass_fds=(slave,),
            check=True,
        )
        assert termios.tcgetattr(slave)[:4] == (present if taken_over else own)[:4]
    finally:
        os.close(master)
        os.close(slave)


def test_a_hang_up_ends_the_run_cleanly(tmp_path: Path) -> None:
    with terminal(*PROGRAM, folder=tmp_path) as screen:
        os.kill(started(screen), signal.SIGHUP)
        screen.wait_for("shell: exit code 0")
        assert screen.is_as_before
        assert (tmp_path / "stopped").exists()


@pytest.mark.parametrize("ignored", ["HUP", "HUP CONT"])
def test_a_terminal_that_is_gone_ends_the_run_cleanly(tmp_path: Path, ignored: str) -> None:
    """Without a signal: the run notices that no key can ever come."""
    with terminal(*PROGRAM, folder=tmp_path, script=f"trap '' {ignored}; exec \"$@\"") as screen:
        started(screen)
        screen.close()
        screen.wait_until((tmp_path / "stopped").exists)


def test_ctrl_and_z_gives_the_terminal_back_until_it_goes_on(tmp_path: Path) -> None:
    with terminal(folder=tmp_path) as shell:
        shell.type(line(*PROGRAM))
        started(shell)
        for back in ("fg", "bg; fg"):  # to a job that runs already the shell does not say that it goes on
            shell.type("\x1a")
            shell.wait_for(r"Stopped.*\$ ")
            assert shell.shell_sees("icanon")
            assert shell.shell_sees("echo")
            shell.type(f"{back}\r")
            shell.wait_until(lambda: shell.is_for_keys)
            shell.type("+")
            shell.wait_for(r"<\+>")
        shell.type("\x1b")
        shell.wait_for(r"<escape>.*\$ ")
        assert shell.shell_sees("icanon")


def test_a_run_that_stood_still_takes_the_terminal_again(tmp_path: Path) -> None:
    """SIGSTOP cannot be handled; whatever the shell made of the terminal, the run sets it when it goes on."""
    with terminal(folder=tmp_path) as shell:
        shell.type(line(*PROGRAM))
        os.kill(started(shell), signal.SIGSTOP)
        shell.wait_for(r"Stopped.*\$ ")
        shell.type("stty sane\r")
        shell.wait_until(lambda: not shell.is_for_keys)
        shell.type("fg\r")
        shell.wait_until(lambda: shell.is_for_keys)
        shell.type("\x1b")
        shell.wait_for("<escape>")


@pytest.mark.parametrize("name", ["sh", "bash"])
def test_in_the_background_the_keys_are_left_to_the_shell(tmp_path: Path, name: str) -> None:
    """bash says nothing to a job that it brings to the foreground if it runs already."""
    if shutil.which(name) is None:
        pytest.skip(f"there is no {name}")
    with terminal(folder=tmp_path, shell=name) as shell:
        shell.type(line(*PROGRAM).replace("\r", " &\r"))
        shell.wait_for(r"process (\d+) runs")
        shell.type("\r")
        shell.wait_for(r"\$ ")
        assert shell.shell_sees("icanon")
        shell.type("fg\r")
        shell.wait_until(lambda: shell.is_for_keys)
        shell.type("\x1b")
        shell.wait_for(r"<escape>.*\$ ")
        assert shell.shell_sees("icanon")


@pytest.fixture
def sources(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What happens to sources of keys, with a standard input that says it is a terminal."""
    happened: list[str] = []
    source = SimpleNamespace(end=lambda: happened.append("ended"))
    monkeypatch.setattr(terminal_keys, "TerminalKeys", lambda session, fd: happened.append(f"begun on {fd}") or source)
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(isatty=lambda: True, fileno=lambda: 7))
    return happened


def session(interactive: bool = True, replaying: bool = False, outputs: Any = ()) -> Any:
    controller = SimpleNamespace(interactive=interactive)
    return SimpleNamespace(controller=controller, replaying=replaying, outputs=outputs)


def test_interactive_run_holds_the_terminal_throughout(sources: list[str]) -> None:
    run = session()
    terminal_keys.begin_keys(run)
    assert sources == ["begun on 7"]
    terminal_keys.end_keys(run)
    assert sources == ["begun on 7", "ended"]


def test_missing_termios_is_told_in_one_line(sources: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """As on Windows, where Python has no module termios. A run whose keys come from a page does not need it."""
    monkeypatch.setitem(sys.modules, "termios", None)
    with pytest.raises(ControllerFailed, match="keys from the terminal need Linux or macOS; steer by the web page"):
        terminal_keys.begin_keys(session())
    terminal_keys.begin_keys(session(outputs=[SimpleNamespace(gives_keys=True)]))
    terminal_keys.begin_keys(session(interactive=False))
    assert sources == []


@pytest.mark.parametrize("run", [session(interactive=False), session(replaying=True)])
def test_no_other_run_touches_it(sources: list[str], run: Any) -> None:
    terminal_keys.begin_keys(run)
    terminal_keys.end_keys(run)
    assert sources == []


@pytest.mark.parametrize("stdin", [None, SimpleNamespace(isatty=lambda: False)])
def test_where_there_is_no_terminal_it_says_so(sources: list[str], monkeypatch: pytest.MonkeyPatch, stdin: Any) -> None:
    monkeypatch.setattr(sys, "stdin", stdin)
    with pytest.warns(UserWarning, match="standard input is not a terminal"):
        terminal_keys.begin_keys(session())
    assert sources == []


def test_it_says_nothing_where_keys_come_from_an_output(sources: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", None)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        terminal_keys.begin_keys(session(outputs=(SimpleNamespace(gives_keys=False), SimpleNamespace(gives_keys=True))))
    assert sources == []


# What terminals send becomes key events, however it is cut into pieces; nothing that they send is misread as Esc.

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
