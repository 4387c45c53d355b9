"""The arrays of a constraint problem."""

import numpy as np

from taichisoft.kernels.compliance import GROUP
from taichisoft.model import Model
from taichisoft.step.gauss_seidel import GaussSeidel


class Rows:
    """Arrays of a problem of so many contacts and cavities of imposed volume.

    Attributes:
        count: of rows, three for each contact and then one for each cavity.
        bodies, vertices, vertex_weights, points, normal: as in Contacts.
        approach: gap over time step of each contact [mm/s], shape (contact_count,).
        friction: coefficient of each contact, shape (contact_count,).
        basis: normal and two tangents of each contact, as rows, shape (contact_count, 3, 3).
        node, weight: soft nodes that a contact acts on and their weights, -1 and 0 in empty slots, shape
            (contact_count, slots).
        rigid: rigid body on each side of a contact, or -1, shape (contact_count, 2).
        rigid_jacobian: of these bodies' velocities, shape (3 contact_count, 2, 6).
        cavities: the cavities, shape (cavity_count,).
        compliance: W [mm/s per mN s and the like for volumes], shape (count, count).
        free: velocities [mm/s] or volume rates [mm^3/s] without impulses, shape (count,).
        impulse: [mN s] of contacts, pressure times step [kPa s] of cavities, shape (count,).
        contact_impulse: on the second body in world axes [mN s], shape (contact_count, 3).
    """

    def __init__(self, model: Model, count: int, cavity_count: int):
        """Make the arrays; the first of `count` contacts has the rows 0, 1 and 2."""
        slots = 6 * model.surfaces.carriers.nodes.shape[1]
        self.count = 3 * count + cavity_count
        self.bodies = np.empty((count, 2), dtype=np.int32)
        self.vertices = np.empty((count, 2, 3), dtype=np.int32)
        self.vertex_weights = np.empty((count, 2, 3))
        self.points = np.empty((count, 2, 3))
        self.normal = np.empty((count, 3))
        self.approach = np.empty(count)
        self.friction = np.empty(count)
        self.basis = np.empty((count, 3, 3))
        self.node = np.empty((count, slots), dtype=np.int32)
        self.weight = np.empty((count, slots))
        self.rigid = np.empty((count, 2), dtype=np.int32)
        self.rigid_jacobian = np.zeros((3 * count, 2, 6))
        self.contact_impulse = np.empty((count, 3))
        self.cavities = np.empty(cavity_count, dtype=np.int32)
        self.compliance = np.empty((self.count, self.count))
        self.free, self.impulse = np.empty(self.count), np.empty(self.count)
        self.gauss_seidel = GaussSeidel(self.count)
        if model.elasticity is not None:
            solver, groups = model.elasticity.solver, -(-self.count // GROUP)
            self.active = np.empty((groups, len(solver.parent)), dtype=np.int32)
            self.columns = np.empty((groups, 3 * len(solver.order), GROUP))
            self.done = np.zeros(1, dtype=np.int32)
