"""A program for the tests of the terminal: shows every key that it gets; some end it in one way or another.

With the argument "alone" it has no child that watches.
"""

import os
import sys
from pathlib import Path

from taichisoft.control.control import KeyStream
from taichisoft_controllers import terminal_mode
from taichisoft_controllers.terminal_keys import TerminalKeys


class Run:
    """What a source of keys needs."""

    def __init__(self) -> None:
        self.keys = KeyStream()
        self.stopped = False

    def stop(self) -> None:
        """Leave `show_keys`."""
        self.stopped = True


def show_keys(run: Run) -> None:
    """Until Esc or the end of the terminal."""
    print("process", os.getpid(), "runs")
    while not run.stopped:
        run.keys.wait(0.02)
        for event in run.keys.take():
            print(f"<{event}>")
            if event.key == "escape":
                run.stop()
            elif event.key == "e":
                raise RuntimeError("an error in the run")
            elif event.key == "f":
                os.environ["FORGETS"] = "to call end()"
                sys.exit(1)
            elif event.key == "x":
                os._exit(3)  # neither `finally` nor atexit
    Path("stopped").touch()


if __name__ == "__main__":
    if "alone" in sys.argv:
        terminal_mode._start_watching_child = lambda *_: None
    shown = Run()
    source = TerminalKeys(shown, sys.stdin.fileno())
    try:
        show_keys(shown)
    except KeyboardInterrupt:
        print("interrupted")
    finally:
        if "FORGETS" not in os.environ:
            source.end()
