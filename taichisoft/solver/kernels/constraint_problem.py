"""The constraint problem of a step, and its iterate."""

from typing import NamedTuple

import numpy as np

from taichisoft.runtime.language import Integers, Scalars, ScalarTable, func, ti
from taichisoft.solver.kernels.axpy import add_multiple
from taichisoft.solver.kernels.row_velocities import ACTUATORS, CONTACTS, MOMENTS


class Problem(NamedTuple):
    """The constraint problem: v = free + W l, with the conditions of contact, friction and actuators.

    Rows of contacts come first, then rows of actuators, whose impulses are efforts times the time step, then rows of
    moments, whose impulses are moments times the time step.

    Attributes:
        size: number of contacts, of actuator rows, and of contacts with moments, shape (3,).
        compliance: W by rows [mm/s per mN s, likewise for volumes], shape (row_capacity^2,).
        free: velocities without impulses [mm/s, of a volume mm^3/s], shape (row_capacity,).
        friction: coefficient of each contact, shape (contact_capacity,).
        bounds: bounds of each actuator row, see `actuator_bounds.py`, shape (actuator_capacity, 6).
        moment_contact, moment_length: contact of each moment, and bounds of the moment, see `row_velocities.Rows`.
    """

    size: Integers
    compliance: Scalars
    free: Scalars
    friction: Scalars
    bounds: ScalarTable
    moment_contact: Integers
    moment_length: ScalarTable

    @classmethod
    def without_moments(
        cls, size: np.ndarray, compliance: np.ndarray, free: np.ndarray, friction: np.ndarray, bounds: np.ndarray
    ) -> "Problem":
        """A problem of contacts and actuators."""
        return cls(size, compliance, free, friction, bounds, np.zeros(0, dtype=np.int32), np.zeros((0, 2)))


class Iterate(NamedTuple):
    """Impulses [mN s, of a volume kPa s] and their velocities [mm/s, of a volume mm^3/s], each (row_capacity,)."""

    impulse: Scalars
    velocity: Scalars


@func
def row_count(problem: Problem) -> ti.i32:
    """Number of rows: three per contact, one per actuator coordinate, three per moment."""
    return first_moment(problem) + 3 * problem.size[MOMENTS]


@func
def first_moment(problem: Problem) -> ti.i32:
    """Index of the first row of the moments."""
    return 3 * problem.size[CONTACTS] + problem.size[ACTUATORS]


@func
def measure_velocity(problem: Problem, iterate: Iterate):
    """Compute velocity = free + W impulse."""
    count = row_count(problem)
    for k in range(count):
        iterate.velocity[k] = problem.free[k]
    for row in range(count):
        if iterate.impulse[row] != 0.0:
            add_multiple(iterate.velocity, 0, iterate.impulse[row], problem.compliance, row * count, count)


@func
def copy_iterate(rows: ti.i32, source: Iterate, target: Iterate):
    """Copy impulses and velocities of the first `rows` rows."""
    for k in range(rows):
        target.impulse[k] = source.impulse[k]
        target.velocity[k] = source.velocity[k]
