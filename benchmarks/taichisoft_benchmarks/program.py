"""Command lines of `python -m`: options by typer, errors in one line, exit codes as of the command `taichisoft`."""

import sys
from collections.abc import Callable
from typing import Any

import typer

from taichisoft.base import printable
from taichisoft.command_line import EXIT_BAD_INPUT, EXIT_INTERRUPTED, USAGE_ERROR
from taichisoft.errors import TaichisoftError


def run_program(function: Callable[..., None], module: str) -> None:
    """Call a function with the options of this process, which ends.

    Args:
        function: has parameters as typer expects them.
        module: what follows `python -m`, such as "taichisoft_benchmarks.studies.convergence".
    """
    application = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    application.command()(function)
    try:
        code: Any = application(prog_name=f"python -m {module}", standalone_mode=False)
        sys.exit(code if isinstance(code, int) else 0)
    except USAGE_ERROR as error:
        _exit_with(f"{error.format_message().rstrip('.')}; see python -m {module} --help")
    except TaichisoftError as error:
        _exit_with(str(error))
    except OSError as error:
        _exit_with(f"{error.filename}: {error.strerror}" if error.filename is not None else str(error))
    except (KeyboardInterrupt, typer.Abort):
        sys.exit(EXIT_INTERRUPTED)


def _exit_with(problem: str) -> None:
    print(f"taichisoft: {printable(' '.join(problem.split()))}", file=sys.stderr)
    sys.exit(EXIT_BAD_INPUT)
