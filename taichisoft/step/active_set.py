"""The active set: contacts that take part in the constraint problem of a step.

Most contacts found stay open: in a grasp five of six, on a finely triangulated ball nearly all. Their compliance rows
cost as much as others, and only give inequalities that hold. So the problem is solved with the contacts that pushed in
the last step or are expected to push; then the motion is checked against all other contacts, and if some would close,
the problem is solved again with the worst of each neighbourhood. The result keeps all contacts apart, whatever the
initial choice (constraint generation).
"""

import numpy as np

from taichisoft.bodies.kernels.rigid_integration import RigidState
from taichisoft.contact.contact_table import NO_CONTACTS, ContactTable
from taichisoft.contact.kernels import separation as kernels
from taichisoft.contact.kernels.turned_gaps import renew_rows
from taichisoft.contact.reduction import ContactReduction
from taichisoft.model import Model
from taichisoft.state import State

# Most times that the rows of a step are renewed, usually two, and how often for contacts that are lifted.
MOST_RENEWALS, MOST_LOWERINGS = 40, 10


class ActiveSet:
    """Measures the separation of the contacts of a step, and chooses the contacts that take part.

    Attributes:
        table: the contacts of the step.
        resting_speed: approach without restitution, the change of speed by gravity in a step [mm/s].
    """

    def __init__(self, model: Model, rigid: RigidState):
        """Prepare for the bodies of `model`, with the rigid bodies in `rigid`."""
        settings = model.scene.contact
        self._surfaces, self._rigid, self._first_rigid = model.surfaces, rigid, len(model.soft_bodies)
        self._time_step, self._tolerance = model.scene.time.step, settings.tolerance
        self._reduction = ContactReduction(model.surfaces.body_size, settings.spacing, settings.contact_distance)
        self._terms = terms = np.zeros(kernels.TERM_COUNT)
        terms[kernels.TIME_STEP], terms[kernels.CONTACT_DISTANCE] = model.scene.time.step, settings.contact_distance
        terms[kernels.TOLERANCE], terms[kernels.KEEPS_DEPTH] = settings.tolerance, settings.depth == "position"
        terms[kernels.HAS_RESTITUTION], terms[kernels.THETA] = model.restitution.any(), model.scene.time.theta
        self._follows_turns = model.scene.time.theta == 1.0
        self._violated_count, self._missed = np.zeros(1, dtype=np.int32), np.zeros(1)
        self._node_position = np.zeros((model.node_count, 3))
        self.table, self.resting_speed, self._renewals = NO_CONTACTS, 0.0, 0

    def begin(self, table: ContactTable, state: State, node_velocity: np.ndarray) -> None:
        """Choose the contacts that are expected to push.

        Args:
            table: all contacts of the step.
            state: state at the start of the step; the rigid bodies have its velocities.
            node_velocity: velocities of the soft nodes at the start [mm/s], shape (node_count, 3).
        """
        self.table, self._renewals = table, 0
        self._node_position[:] = state.position  # reused: a kernel launch with new arrays takes longer
        self._reduction.begin(table, state)
        kernels.begin_separation(
            self._first_rigid,
            self._terms,
            table.found,
            table.fraction,
            self._surfaces.gap_tolerance,
            self._surfaces.vertex_is_round,
            self._surfaces.carriers,
            node_velocity,
            self._rigid,
            table.separation,
            table.choice,
        )
        self.resting_speed = max(self._tolerance, self._time_step * float(np.linalg.norm(state.gravity)))
        self._reduction.add_wanted(table, beside=False)

    def add_violated(self, node_velocity: np.ndarray) -> bool:
        """Add contacts that close with these node velocities [mm/s] and the rigid bodies' own; True if any.

        Where that turns bodies so far that a gap is another than its row's, the row is renewed, which counts as well.
        """
        self._find_violated(node_velocity)
        self._missed[0] = 0.0
        if self._violated_count[0] and self._reduction.add_wanted(self.table, beside=True):
            return True  # rows are renewed for a motion of all contacts: what turns about some of them does not
        if not (self._follows_turns and self._rigid.angular.any()):
            return False
        self._terms[kernels.MAY_LIFT] = self._renewals >= MOST_LOWERINGS
        renew_rows(
            self._first_rigid,
            self._terms,
            self.table.found,
            self._surfaces.vertex_is_round,
            self._surfaces.carriers,
            self._node_position,
            node_velocity,
            self._rigid,
            self.table.separation,
            self.table.choice,
            self._violated_count,
            self._missed,
        )
        added = bool(self._violated_count[0]) and self._reduction.add_wanted(self.table, beside=True)
        self._renewals += bool(self._missed[0])
        return added or (self.missed > 0.0 and self._renewals < MOST_RENEWALS)

    @property
    def missed(self) -> float:
        """Largest velocity by which a gap at the end of the step is another than its row's [mm/s]."""
        return float(self._missed[0]) / self._time_step

    def add_deep(self, moving: np.ndarray | None) -> bool:
        """Add contacts that overlap at the end of the step; True if any.

        Args:
            moving: velocities along which the step moves the nodes, and the rigid bodies have theirs, where these are
                not the velocities after it [mm/s], shape (node_count, 3); else None.
        """
        if moving is not None:
            self._find_violated(moving)
            self.table.gap[:] -= self._time_step * self.table.separation.unhurried[: self.table.contact_count]
        gap = self.table.gap
        deep = gap < self._deepest_left
        if not deep.any():
            return False
        self._reduction.add(self.table, deep, gap, beside=True)
        return True

    def add_left_deep(self, node_velocity: np.ndarray) -> bool:
        """Add contacts that overlap after a shift by these node velocities [mm/s] and the rigid bodies' own."""
        gap = self.table.gap.copy()
        self._find_violated(node_velocity)
        left = gap + self._time_step * self.table.separation.speed[: self.table.contact_count]
        added = self._reduction.add(self.table, left < self._deepest_left, left, beside=True)
        self.table.gap[:] = gap
        return added

    @property
    def _deepest_left(self) -> np.ndarray:
        """Gap of each contact below which it is an overlap to remove [mm], shape (contact_count,).

        A contact at the depth `touching` counts as an overlap, on whichever side of it the solver's tolerance leaves
        the contact: when round-off decided, the final speed of a rolling ball varied by 0.5 % between runs.
        """
        return self._time_step * self._tolerance - self.table.separation.touching[: self.table.contact_count]

    def _find_violated(self, node_velocity: np.ndarray) -> None:
        kernels.find_violated(
            self._first_rigid,
            self._terms,
            self.table.found,
            self._surfaces.carriers,
            node_velocity,
            self._rigid,
            self.table.separation,
            self.table.choice,
            self._violated_count,
        )
