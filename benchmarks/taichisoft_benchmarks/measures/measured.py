"""The outcome of one repetition of a case, and functions of all measurements."""

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from taichisoft import Scene

if TYPE_CHECKING:
    from taichisoft.running import Simulation
    from taichisoft.step import StepReport


@dataclass
class Measured:
    """Figures and facts of one repetition.

    Attributes:
        figures: values by metric; the end of a metric's name is its unit (_ms, _s, _mb).
        facts: properties of the case, such as its number of nodes.
        phases: time of each phase of the step at the end of the case [ms].
        does_not: parts of the job that another program leaves out; empty for taichisoft itself.
    """

    figures: dict[str, float] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)
    phases: dict[str, float] = field(default_factory=dict)
    does_not: str = ""


def peak_memory() -> float:
    """Largest memory of this process so far [MB]; 0 if the system does not report it."""
    if sys.platform == "win32":
        return 0.0
    import resource

    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return float(used) / (2**20 if sys.platform == "darwin" else 2**10)


def controlled_step(simulation: "Simulation", scene: Scene) -> "Callable[[], StepReport]":
    """A function that makes one step, driven by a new controller of the scene."""
    from taichisoft.running import make_controller

    controller = make_controller(scene)
    controller.reset(simulation.model)
    return lambda: simulation.step(controller.control(simulation.observe()))
