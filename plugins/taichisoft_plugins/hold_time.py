"""Is there time left to see whether an object is held? Said before a run that moves the base nearly until its end."""

import math
import warnings
from typing import TYPE_CHECKING

from taichisoft_plugins.metrics import MetricsOutput

if TYPE_CHECKING:
    from taichisoft.session.session import Session


def warn_of_late_motion(session: "Session") -> None:
    """Warn where the base is known to move while the object of the goal must stand still, at the end of the run."""
    scene, start = session.simulation.model.scene, session.first_state.time
    goal, end = scene.goal, start + session.step_count * scene.time.step
    is_judged = any(isinstance(output, MetricsOutput) for output in session.outputs)
    if goal is None or goal.kind == "lifted" or not is_judged or session.replaying or not math.isfinite(end):
        return
    stop = session.controller.base_stops_at(session.simulation.observe())
    if stop is None or stop <= start or end - stop > goal.hold - 0.5 * scene.time.step:
        return
    warnings.warn(
        f"the controller moves the base until {stop:g} s, and the run ends at {end:g} s: '{goal.object}' counts as "
        f"{goal.kind} only if it stands still for the last {goal.hold:g} s (goal.hold), so a duration of "
        f"{stop + goal.hold - start:g} s or more is needed",
        stacklevel=2,
    )
