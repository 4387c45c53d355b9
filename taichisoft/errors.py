"""Errors for users: each message is one line with the problem, its place, and what would be valid."""

import difflib
from collections.abc import Sequence
from traceback import walk_tb


class TaichisoftError(Exception):
    """Base of all errors that a user can correct; the command line and notebooks show them without a traceback."""

    def _render_traceback_(self) -> list[str]:
        """What IPython shows instead of a traceback: the line of the cell, and the message."""
        lines = [line for frame, line in walk_tb(self.__traceback__) if frame.f_globals.get("__name__") == "__main__"]
        place = f", line {lines[-1]}" if lines else ""
        return [f"{type(self).__name__}{place}: {' '.join(str(self).split())}"]


class SceneError(TaichisoftError):
    """A scene is not valid: a wrong key, type, value or selection."""


class MeshError(TaichisoftError):
    """A mesh or surface file is missing, unreadable, or cannot be simulated."""


class PluginError(TaichisoftError):
    """A plug-in cannot be found or loaded, or returned an invalid value."""


class PluginFailed(PluginError):
    """A plug-in failed; its exception is the cause of this one."""


class PackageMissing(TaichisoftError, ImportError):
    """A package is not installed that only this part needs; the message says what installs it."""


class ControlError(TaichisoftError):
    """A controller requested something that the model does not have, or a value that is not finite."""


class StateError(TaichisoftError):
    """A saved state cannot be read, or belongs to another model."""


class NotPositiveDefinite(TaichisoftError):
    """The system matrix has a pivot that is not positive.

    Attributes:
        node: index of the soft node at which the factorisation stopped.
    """

    def __init__(self, message: str, node: int):
        super().__init__(message)
        self.node = node


class SimulationDiverged(TaichisoftError):
    """A step diverged: positions are not finite or explode, or too many elements are inverted.

    Attributes:
        body: name of the body.
        step: index of the failed step; the state before it is kept.
        cause: text about the problem.
        advice: text about possible corrections.
    """

    def __init__(self, body: str, step: int, cause: str, advice: str):
        super().__init__(f"step {step}: body '{body}' {cause}; try {advice}")
        self.body = body
        self.step = step
        self.cause = cause
        self.advice = advice


class EquilibriumNotFound(SimulationDiverged):
    """Bodies have no equilibrium under their loads, or none that the search has found."""


class ForkedProcess(TaichisoftError):
    """A process forked after the start of the simulator tried to compute, which would block for ever."""


class GoalMissed(TaichisoftError):
    """The run completed, but missed the goal of its scene."""


class BeyondLaw(GoalMissed):
    """The run completed, but stretched a body far beyond the range of its law, or left elements inverted."""


class ControllerFailed(GoalMissed):
    """A controller failed; the message names the condition that it waited for, or the problem."""


def nearest(name: str, valid: Sequence[str], what: str) -> str:
    """Hint at the end of an error about a name: the most similar valid name, or all valid names."""
    near = difflib.get_close_matches(name, valid, n=1)
    return f"did you mean '{near[0]}'?" if near else f"{what}: {', '.join(valid) or 'none'}"
