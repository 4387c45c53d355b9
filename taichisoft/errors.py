"""What a user can be told: each error is one line that says what is wrong, where, and what would be valid."""

import difflib
from collections.abc import Sequence


class TaichisoftError(Exception):
    """Base of every error that is the user's to mend; the command line prints it without a traceback."""


class SceneError(TaichisoftError):
    """A scene cannot be understood: a wrong key, type, value or selection."""


class MeshError(TaichisoftError):
    """A mesh or surface file is missing, unreadable, or not fit to simulate."""


class PluginError(TaichisoftError):
    """A plug-in cannot be found or loaded, or answered something that is not valid."""


class PluginFailed(PluginError):
    """A plug-in raised something that it should not have; its own exception is the cause of this one."""


class ControlError(TaichisoftError):
    """A controller asked for something that the model does not have, or that is not a finite number."""


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
    """A step gave positions that are not finite, exploding, or inverted beyond repair.

    Attributes:
        body: name of the body.
        step: index of the step that failed; the state before it is kept.
        cause: text about what was found.
        advice: text about what to try.
    """

    def __init__(self, body: str, step: int, cause: str, advice: str):
        super().__init__(f"step {step}: body '{body}' {cause}; try {advice}")
        self.body = body
        self.step = step
        self.cause = cause
        self.advice = advice


class ForkedProcess(TaichisoftError):
    """A process that was forked after the simulator had started tried to compute; it would have waited for ever."""


class GoalMissed(TaichisoftError):
    """The run went to its end, but not to the goal of its scene."""


class BeyondLaw(GoalMissed):
    """The run went to its end, but stretched a body far beyond what its law holds for, or left it inside out."""


class ControllerFailed(GoalMissed):
    """A controller gave up: it says what it waited for, or what went wrong."""


def nearest(name: str, valid: Sequence[str], what: str) -> str:
    """The hint that ends an error about a name: the most similar valid one, or all of them."""
    near = difflib.get_close_matches(name, valid, n=1)
    return f"did you mean '{near[0]}'?" if near else f"{what}: {', '.join(valid) or 'none'}"
