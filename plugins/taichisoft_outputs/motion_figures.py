"""How far objects slide on the fingers that hold them."""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from taichisoft.mechanics import State

# The moment before the base moves, from which lift and slip are counted.


def last_at_rest(base_translation: np.ndarray) -> int | None:
    """Index of the last translation, of shape (count, 3), before the base leaves the first one; None where it stays."""
    moved = np.flatnonzero((base_translation != base_translation[0]).any(axis=1))
    return int(moved[0]) - 1 if len(moved) else None


class Slipping:
    """Follows the rigid bodies of a run, step by step.

    The motion of a held body against its fingers is the tangential velocity between their surfaces, averaged over the
    contacts of soft bodies that press it, each weighted by its normal force. Fingers that bend or lag behind the base
    take the body along, which is not slip. A body that no finger presses moves against the base.
    """

    def __init__(self, soft_count: int, state: "State"):
        """Begin with a state; bodies below `soft_count` are soft, the rigid ones follow."""
        self._soft_count = soft_count
        self._last = state

    def restart(self, state: "State") -> None:
        """Go on from another state."""
        self._last = state

    def add(self, state: "State") -> np.ndarray:
        """Way of each rigid body against what holds it in the step that led to this state [mm], (rigid_count, 3)."""
        last, self._last = self._last, state
        base = state.base_translation - last.base_translation
        ways: np.ndarray = state.rigid_position - last.rigid_position - base
        if not len(state.contact_body_pair):
            return ways
        duration = state.time - last.time
        pressing = np.einsum("cd,cd->c", state.contact_impulse, state.contact_normal)
        soft = state.contact_body_pair < self._soft_count
        for body in range(len(ways)):
            # A contact's slip is that of its second body on its first.
            mine = state.contact_body_pair == self._soft_count + body
            held = pressing * ((mine[:, 1] & soft[:, 0]) | (mine[:, 0] & soft[:, 1]))
            if held.any():
                sign = np.where(mine[:, 1], 1.0, -1.0)
                ways[body] = duration * (held * sign) @ state.contact_slip / held.sum()
        return ways
