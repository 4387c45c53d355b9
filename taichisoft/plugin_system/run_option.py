"""An option of `taichisoft run` that a plug-in adds."""

from dataclasses import dataclass


@dataclass(frozen=True)
class RunOption:
    """An option of `taichisoft run`.

    Attributes:
        output: name of the output that takes part in the run when the option is given.
        help: one line for `taichisoft run --help`.
        setting: argument of that output's factory which gets the value; without one the option is a flag.
        type: of the value: str, int, float, bool (for a flag that is a setting) or pathlib.Path.
        metavar: how the help calls the value.
        controller: drives the run where the command line names none; None for the scene's own.
    """

    output: str
    help: str
    setting: str | None = None
    type: type = str
    metavar: str | None = None
    controller: str | None = None
