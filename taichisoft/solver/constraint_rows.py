"""The arrays of a constraint problem, with spare capacity."""

import numpy as np

from taichisoft.cholesky.kernels.sparse_columns import GROUP, SparseColumns
from taichisoft.model import Model
from taichisoft.runtime.launch import forget
from taichisoft.solver.contact_solver import ContactSolver
from taichisoft.solver.kernels.actuator_bounds import BOUND_COLUMNS
from taichisoft.solver.kernels.constraint_problem import Problem
from taichisoft.solver.kernels.row_velocities import CONTACTS, MOMENTS, Rows

# Little spare capacity, because the arrays are large with several hundred contacts.
GROWTH = 1.25


class ConstraintRows:
    """Three rows per contact, one per actuator coordinate without a known load, and three per moment.

    Attributes:
        contact_capacity: largest number of contacts.
        rows: bodies and nodes on which the rows act.
        compliance: W by rows [mm/s per mN s, likewise for volumes], shape (row_capacity^2,).
        columns: work space of the compliance.
        bounds: bounds of the actuator rows, see `solver/kernels/actuator_bounds.py`, shape (actuator_capacity, 6).
        solver: contact solver, with the impulses and velocities of the rows.
    """

    def __init__(self, model: Model, contact_capacity: int):
        """Allocate rows for `contact_capacity` contacts and all actuators of the model."""
        actuator_capacity = model.actuators.count
        moments = model.rolling_friction.any() or model.spinning_friction.any()
        moment_capacity = contact_capacity if moments else 0
        row_capacity = 3 * contact_capacity + actuator_capacity + 3 * moment_capacity
        slots = 6 * model.surfaces.carriers.nodes.shape[1]
        self.contact_capacity = contact_capacity
        self.rows = Rows(
            size=np.zeros(3, dtype=np.int32),
            contact=np.empty(contact_capacity, dtype=np.int32),
            on_rigid=np.empty(contact_capacity, dtype=np.int32),
            on_rigid_count=np.zeros(1, dtype=np.int32),
            basis=np.empty((contact_capacity, 3, 3)),
            node=np.empty((contact_capacity, slots), dtype=np.int32),
            weight=np.empty((contact_capacity, slots)),
            rigid=np.empty((contact_capacity, 2), dtype=np.int32),
            rigid_jacobian=np.zeros((3 * contact_capacity, 2, 6)),
            friction=np.empty(contact_capacity),
            gap_rate=np.empty(contact_capacity),
            coordinate=np.empty(actuator_capacity, dtype=np.int32),
            target_rate=np.empty(actuator_capacity),
            moment_contact=np.empty(moment_capacity, dtype=np.int32),
            moment_length=np.empty((moment_capacity, 2)),
            free=np.empty(row_capacity),
        )
        self.compliance = np.empty(row_capacity**2)
        self.bounds = np.empty((actuator_capacity, BOUND_COLUMNS))
        self.solver = ContactSolver(
            Problem(
                self.rows.size,
                self.compliance,
                self.rows.free,
                self.rows.friction,
                self.bounds,
                self.rows.moment_contact,
                self.rows.moment_length,
            )
        )
        self._acts_on_soft = model.elasticity is not None
        if model.elasticity is not None:
            symbolic, groups = model.elasticity.symbolic, -(-row_capacity // GROUP)
            self.columns = SparseColumns.with_room(groups, len(symbolic.tree.parent), 3 * len(symbolic.order))

    @property
    def contact_count(self) -> int:
        """Number of contacts with rows."""
        return int(self.rows.size[CONTACTS])

    @property
    def moment_count(self) -> int:
        """Number of contacts with rows of moments."""
        return int(self.rows.size[MOMENTS])

    @property
    def row_count(self) -> int:
        """Number of rows."""
        contacts, actuators, moments = self.rows.size.tolist()
        return 3 * (contacts + moments) + actuators

    @property
    def actuators(self) -> slice:
        """The rows of the actuators."""
        contacts, actuators, _ = self.rows.size.tolist()
        return slice(3 * contacts, 3 * contacts + actuators)

    def make_room_for_columns(self, entry_count: int) -> None:
        """Enlarge `columns.y` to at least `entry_count` entries; the old entries are lost."""
        if entry_count > len(self.columns.y):
            forget(self.columns)
            self.columns = self.columns._replace(y=np.empty((int(GROWTH * entry_count), GROUP)))

    def release(self) -> None:
        """Release the arrays from kernels before larger ones replace them."""
        forget(self.rows, *([self.columns] if self._acts_on_soft else []))
        self.solver.release()
