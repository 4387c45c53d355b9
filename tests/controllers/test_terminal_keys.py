"""The terminal as a source of keys, in a pseudo-terminal: what arrives, and that the terminal is always put back."""

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
from terminal import Terminal, line, python, terminal

from taichisoft.errors import ControllerFailed
from taichisoft_controllers import terminal_keys, terminal_mode

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
def test_the_watching_child_leaves_alone_what_another_program_has_set(taken_over: bool) -> None:
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


def test_an_interactive_run_has_the_terminal_from_its_beginning_to_its_end(sources: list[str]) -> None:
    run = session()
    terminal_keys.begin_keys(run)
    assert sources == ["begun on 7"]
    terminal_keys.end_keys(run)
    assert sources == ["begun on 7", "ended"]


def test_where_terminals_are_not_those_of_posix_one_line_says_what_to_do(
    sources: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
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
