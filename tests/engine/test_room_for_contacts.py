"""When more contacts need more room, the arrays for fewer of them are freed: with many contacts they are large."""

import weakref

from taichisoft import Simulation
from taichisoft.scene import scene_from_dict
from taichisoft.step.constraint_solver import FIRST_CAPACITY

COUNT = FIRST_CAPACITY // 4 + 1
"""Boxes with four corners each, some more than there is room for at first."""


def test_arrays_for_fewer_contacts_are_freed() -> None:
    floor = {"plane": {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}}
    box = {"box": [10.0, 10.0, 10.0], "mass": 0.01, "velocity": [0.0, 0.0, -100.0]}
    boxes = {f"box{k}": {**box, "position": [20.0 * k, 0.0, 6.1]} for k in range(COUNT)}
    boxes["box0"]["position"] = [0.0, 0.0, 16.0]  # it is there last
    tables = {"rigid_bodies": boxes, "obstacles": {"floor": floor}}
    simulation = Simulation(scene_from_dict({"gravity": [0.0, 0.0, -9810.0], **tables}))
    solver = simulation._constraint_solver
    small = weakref.ref(solver._rows.compliance)
    simulation.step()
    assert small() is solver._rows.compliance
    for _ in range(20):
        report = simulation.step()
    assert report.contact_count == 4 * COUNT
    assert solver._rows.contact_capacity >= 4 * COUNT
    assert small() is None
