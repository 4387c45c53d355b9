"""Reduced models: forces of domains, modes, weights, the frame of the base, and what is refused."""

import numpy as np
import pytest
import scipy.optimize
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from taichisoft import Control, Simulation, make_model, scene_from_dict
from taichisoft.bodies.elasticity import internal_force
from taichisoft.command_line import application
from taichisoft.errors import TaichisoftError
from taichisoft_reduction.basis import Basis
from taichisoft_reduction.body_shapes import RelativeMotion, base_frame, body_shapes
from taichisoft_reduction.command import reduce
from taichisoft_reduction.comparison import compare, worst
from taichisoft_reduction.cubature import MotionCriterion, NonNegativeSearch, choose_domains
from taichisoft_reduction.domain_forces import DomainForces
from taichisoft_reduction.errors import ReductionError
from taichisoft_reduction.reduction import Progress, Wishes, reduce_scene
from taichisoft_reduction.run_request import RunRequest, RunResult, Timetable

ANCHORS = [{"box": [[-0.1, -0.1, -0.1], [0.1, 9.0, 9.0]]}]
TURNED = {"rotation": [20.0, -35.0, 50.0], "translation": [3.0, 1.0, -2.0]}


def beam(block, **body):
    """A beam of few elements, held at one end and placed askew."""
    table = {"mesh": block((4, 1, 1), (20.0, 5.0, 5.0)), "density": 1e-6, "poisson_ratio": 0.3, "anchors": ANCHORS}
    return scene_from_dict({"soft_bodies": {"beam": {**table, **TURNED, **body}}})


def random_modes(body, count):
    rng = np.random.default_rng(0)
    columns = np.linalg.qr(rng.standard_normal((3 * len(body.rest_position), count)))[0]
    return columns.reshape(-1, 3, count)


@pytest.mark.parametrize(
    "law",
    [
        {"element": "linear", "young_modulus": 100.0},
        {"element": "smoothed", "young_modulus": 100.0},
        {"element": "quadratic", "young_modulus": 100.0, "law": "neo-hookean"},
        {"element": "smoothed", "law": "mooney-rivlin", "coefficients": {"c10": 15.0, "c01": 4.0}},
    ],
    ids=lambda law: f"{law['element']}-{law.get('law', 'hooke')}",
)
def test_the_domains_together_have_the_forces_of_the_engine(block, law):
    """f_r = Phi^T f, to rounding: the same law, computed by kernels in space and by numpy in the mesh's frame."""
    model = make_model(beam(block, **law))
    (body,) = model.soft_bodies
    forces = DomainForces(body, random_modes(body, 5))
    amplitudes = np.array([3.0, -2.0, 1.0, 2.0, -1.0])
    turn = Rotation.from_euler("xyz", TURNED["rotation"], degrees=True).as_matrix()
    moved = body.rest_position + (forces.modes @ amplitudes) @ turn.T
    expected = np.einsum("nir,ni->r", forces.modes, internal_force(model.elasticity, moved) @ turn)
    found = -forces.forces(amplitudes).sum(axis=0) - forces.anchor @ amplitudes
    assert np.abs(found - expected).max() < 1e-9 * np.abs(forces.anchor @ amplitudes).max()
    own = -forces.forces(amplitudes).sum(axis=0)
    free = (~body.anchored)[:, None, None] * forces.modes
    assert np.einsum("nir,ni->r", free, internal_force(model.elasticity, moved) @ turn) == pytest.approx(
        -DomainForcesOfFree(body, forces, free, amplitudes), rel=1e-8, abs=1e-8 * np.abs(own).max()
    )
