"""What one repetition of a case gives."""

import sys
from dataclasses import dataclass, field
from typing import Any


@dataclass
class Measured:
    """Figures and facts of one repetition.

    Attributes:
        figures: values by metric; the end of a metric's name is its unit (_ms, _s, _mb).
        facts: what the case turned out to be.
        phases: [ms] by phase of the step, by window.
        does_not: what another program leaves out of the job; empty for taichisoft itself.
    """

    figures: dict[str, float] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)
    phases: dict[str, dict[str, float]] = field(default_factory=dict)
    does_not: str = ""


def peak_memory() -> float:
    """Largest memory of this process so far [MB]; 0 where the system does not tell."""
    if sys.platform == "win32":
        return 0.0
    import resource

    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return float(used) / (2**20 if sys.platform == "darwin" else 2**10)
