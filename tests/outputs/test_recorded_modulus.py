"""Young's moduli that change in a run: what is made of its recording has those of the frame."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import pyvista
from tiny_run import make_run

from taichisoft import Control, Simulation, load_scene
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft_outputs import Recording, read_recording
from taichisoft_outputs.drawing.colouring import stress
from taichisoft_outputs.paraview import export_vtu
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.recording.resume import recorded_scene, resumed_simulation, state_at
from taichisoft_outputs.stress import StressLaw, nodal_mean, von_mises

REGION = "{box = [[-100.0, -100.0, -100.0], [100.0, 100.0, 0.0]], young_modulus = 300.0}"
CONTROLS = (
    {},
    {"left": 50.0, "left.regions.0": 900.0},
    {"right": 40.0},
)  # fmt: skip
MODULI = (
    {"left": 100.0, "left.regions.0": 300.0, "right": 100.0},
    {"left": 100.0, "left.regions.0": 300.0, "right": 100.0},
    {"left": 50.0, "left.regions.0": 900.0, "right": 100.0},
    {"left": 50.0, "left.regions.0": 900.0, "right": 40.0},
)
"""What is asked for in each step, and the moduli [kPa] of each frame: that before the first step, then the others."""


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Recording]:
    """A run in which the fingers are inflated and change their stiffness, one of them with a stiff lower half."""
    regions = [f"soft_bodies.left.regions=[{REGION}]", "soft_bodies.right.regions=[]"]
    simulation = Simulation(load_scene(TINY_GRIPPER, regions))
    output = RecordingOutput(tmp_path_factory.mktemp("run"))
    pressure = dict.fromkeys(simulation.model.cavities.names, 5.0)
    make_run(simulation, [output], [Control(pressure=pressure, young_modulus=moduli) for moduli in CONTROLS])
    with read_recording(output.path) as opened:
        yield opened


def element_moduli(recording: Recording, frame: int) -> list[np.ndarray]:
    """Young's modulus of each element of each body [kPa], from what the fixture asks for."""
    moduli = []
    for body in recording.soft_bodies:
        of_body = np.full(len(body.elements), MODULI[frame][body.name])
        if body.name == "left":
            of_body[body.mesh_nodes[body.elements].mean(axis=1)[:, 2] < 0.0] = MODULI[frame]["left.regions.0"]
            assert len(set(of_body)) == 2
        moduli.append(of_body)
    return moduli


def element_stress(recording: Recording, frame: int) -> list[np.ndarray]:
    """Von Mises stress of each element of each body [kPa]."""
    position = recording.row("position", frame)
    laws = [
        StressLaw(body.rest_position, body.elements, body.poisson_ratio, polar=True) for body in recording.soft_bodies
    ]
    return [
        von_mises(law.stress(position[body.nodes], moduli))
        for law, body, moduli in zip(laws, recording.soft_bodies, element_moduli(recording, frame), strict=True)
    ]


def test_moduli_are_recorded_frame_by_frame(recording: Recording) -> None:
    for frame, moduli in enumerate(MODULI):
        assert dict(zip(recording.materials, recording.row("young_modulus", frame), strict=True)) == moduli


@pytest.mark.parametrize("frame", [1, 2, 3])
def test_colours_of_stress_are_those_of_the_present_stiffness(recording: Recording, frame: int) -> None:
    expected = [
        nodal_mean(values, body.elements, body.rest_position)
        for body, values in zip(recording.soft_bodies, element_stress(recording, frame), strict=True)
    ]
    np.testing.assert_allclose(stress(recording)(frame), np.concatenate(expected), rtol=1e-12)


def test_the_export_has_stiffness_and_stress_of_each_frame(recording: Recording, tmp_path: Path) -> None:
    export_vtu(recording, [1, 2, 3], tmp_path)
    for frame in (1, 2, 3):
        cells = pyvista.read(tmp_path / "soft_bodies" / f"{frame:05d}.vtu").cell_data
        np.testing.assert_array_equal(cells["young_modulus [kPa]"], np.concatenate(element_moduli(recording, frame)))
        expected = np.concatenate(element_stress(recording, frame))
        np.testing.assert_allclose(cells["von_mises [kPa]"], expected, rtol=1e-5, atol=1e-6 * expected.max())


@pytest.mark.parametrize("frame", [1, 2])
def test_a_resumed_run_is_the_one_that_went_on(recording: Recording, frame: int) -> None:
    """From before and from between two changes, which are made again."""
    simulation = resumed_simulation(recording, frame, recording.scene)
    for step in range(frame, len(CONTROLS)):
        simulation.step(Control(young_modulus=CONTROLS[step]))
        assert simulation.state == state_at(recording, step + 1)


@pytest.mark.parametrize(
    ("overrides", "changed"),
    [
        (["contact.friction=0.3"], {}),
        (["soft_bodies.right.young_modulus=200.0"], {"right": 200.0}),
        (["soft_bodies.left.regions.0.young_modulus=120.0"], {"left.regions.0": 120.0}),
        ([f"soft_bodies.right.regions=[{REGION}]"], {"right.regions.0": 300.0}),
    ],
)
def test_a_modulus_that_is_set_for_the_rest_is_that_of_the_rest(
    recording: Recording, overrides: list[str], changed: dict[str, float]
) -> None:
    """Others stay what the controller made of them."""
    simulation = resumed_simulation(recording, 3, recorded_scene(recording, overrides, None))
    moduli = dict(zip(simulation.model.material_names, simulation.state.young_modulus.tolist(), strict=True))
    assert moduli == MODULI[3] | changed
