"""The contacts of a state, summed up by pair of bodies."""

from dataclasses import dataclass, field

import numpy as np

from taichisoft.control.observation import Pair
from taichisoft.model import Model
from taichisoft.state import State


@dataclass(frozen=True)
class ContactSummary:
    """Figures by pair of bodies, in the scene's order ("finger1", "cube"), between which contacts were found.

    Attributes:
        counts: contacts that press.
        normal_forces: sum of the normal forces [mN].
        friction_forces: sum of the magnitudes of the friction forces [mN].
        slip_speeds: fastest sliding of a contact that presses [mm/s].
        points: middles of the contacts, the open ones too [mm], shape (count, 3).
        forces: force on the second body in each of these [mN], shape (count, 3).
    """

    counts: dict[Pair, int] = field(default_factory=dict)
    normal_forces: dict[Pair, float] = field(default_factory=dict)
    friction_forces: dict[Pair, float] = field(default_factory=dict)
    slip_speeds: dict[Pair, float] = field(default_factory=dict)
    points: dict[Pair, np.ndarray] = field(default_factory=dict)
    forces: dict[Pair, np.ndarray] = field(default_factory=dict)


def summarise_contacts(model: Model, state: State) -> ContactSummary:
    """Counts, forces and sliding in the step that led to `state`."""
    if not len(state.contact_body_pair):
        return ContactSummary()
    forces = state.contact_impulse / model.scene.time.step
    along = np.einsum("cd,cd->c", forces, state.contact_normal)
    across = np.linalg.norm(forces - along[:, None] * state.contact_normal, axis=1)
    slip_speeds = np.linalg.norm(state.contact_slip, axis=1)
    order = np.lexsort(state.contact_body_pair.T[::-1])
    body_pair = state.contact_body_pair[order]
    start = np.flatnonzero(np.diff(body_pair, axis=0, prepend=-1).any(axis=1))
    names = [(model.body_names[first], model.body_names[second]) for first, second in body_pair[start]]
    return ContactSummary(
        counts=dict(zip(names, np.add.reduceat(along[order] > 0.0, start, dtype=np.int64).tolist(), strict=True)),
        normal_forces=dict(zip(names, np.add.reduceat(along[order], start).tolist(), strict=True)),
        friction_forces=dict(zip(names, np.add.reduceat(across[order], start).tolist(), strict=True)),
        slip_speeds=dict(zip(names, np.maximum.reduceat(slip_speeds[order], start).tolist(), strict=True)),
        points=_by_pair(names, state.contact_point[order], start),
        forces=_by_pair(names, forces[order], start),
    )


def _by_pair(names: list[Pair], rows: np.ndarray, start: np.ndarray) -> dict[Pair, np.ndarray]:
    """The rows of each pair, which stand together from `start` on."""
    ends = [*start[1:].tolist(), len(rows)]  # np.split takes three times as long
    return {name: rows[first:end] for name, first, end in zip(names, start.tolist(), ends, strict=True)}
