"""The reduced models that ship: they belong to the shipped meshes, and move as the full fingers do."""

import json
from pathlib import Path

import numpy as np
import pytest

from taichisoft import Control, Simulation, load_scene, make_model
from taichisoft.running import with_reduced_bodies
from taichisoft.scene import data_folder

FOLDER = data_folder() / "reduced"
SCENES = sorted(path.name for path in FOLDER.iterdir())
STEPS = 60


def test_shipped_models_are_small():
    """All together they are below 2 MB, which the wheel grows by."""
    assert 0 < sum(path.stat().st_size for path in FOLDER.glob("*/*.npz")) < 2e6


@pytest.mark.parametrize("name", SCENES)
def test_shipped_models_move_as_the_full_body(name):
    """While actuators go to 0.8 of their trained range, no node is farther off than by the error that the file states.

    The mesh is that which the modes were made of, to the bit; model and modes refuse other materials and masses.
    """
    scene = load_scene(name)
    full, reduced = (Simulation(make_model(each)) for each in (scene, with_reduced_bodies(scene, Path(name))))
    body = reduced.model.soft_bodies[0]
    assert np.array_equal(body.modes.rest_position, body.mesh.nodes)
    drives = json.loads(body.modes.drives)
    missed, moved = 0.0, 0.0
    for step in range(1, STEPS + 1):
        request = {}
        for of_body in reduced.model.soft_bodies:
            for actuator, (key, _, high) in drives.items():
                request.setdefault(key, {})[f"{of_body.name}.{actuator}"] = 0.8 * high * step / STEPS
        for simulation in (full, reduced):
            simulation.step(Control(**request))
        nodes = body.nodes
        missed = max(missed, float(np.linalg.norm(full.state.position - reduced.state.position, axis=1)[nodes].max()))
        moved = max(moved, float(np.linalg.norm(full.state.position[nodes] - body.rest_position, axis=1).max()))
    assert moved > 5.0
    assert missed < body.modes.error * moved
