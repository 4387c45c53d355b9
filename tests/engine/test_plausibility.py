"""Numbers that no soft robot has: a warning with the unit that was probably meant; far beyond, an error."""

import re
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from taichisoft import Control, Simulation, VolumeMesh, equilibrium, make_model, read_volume_mesh, write_volume_mesh
from taichisoft.errors import SceneError, SimulationDiverged
from taichisoft.scene import scene_from_dict

BODY = {"density": 1e-6, "young_modulus": 300.0, "poisson_ratio": 0.3}
CAVITY, PAPER = {"group": "cavity"}, {"group": "cavity", "thickness": 0.1}
CUBE = {"box": [40.0] * 3, "mass": 0.05}


def told(scene: dict[str, Any]) -> list[str]:
    """The warnings about a scene."""
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        make_model(scene_from_dict(scene))
    return [str(warning.message) for warning in seen if warning.category is UserWarning]


def soft(mesh: str, **changes: Any) -> dict[str, Any]:
    return {"soft_bodies": {"finger": {**BODY, "mesh": mesh, **changes}}}


def rigid(**changes: Any) -> dict[str, Any]:
    return {"rigid_bodies": {"cube": {key: value for key, value in {**CUBE, **changes}.items() if value is not None}}}


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"young_modulus": 0.3}, "finger.young_modulus = 0.3 kPa: soft robots have 0.5 to 50000; 0.3 MPa are 300 kPa"),
        ({"young_modulus": 3e5}, "= 300000 kPa: soft robots have 0.5 to 50000; 300000 Pa are 300 kPa"),
        ({"cavities": {"air": {**CAVITY, "highest_pressure": 3e4}}}, "cavities.air.highest_pressure = 30000 kPa:"),
        ({"membranes": {"paper": {**PAPER, "young_modulus": 3e9}}}, "3e+09 Pa are 3e+06 kPa"),
        ({"density": 1070.0}, "1070 kg/m^3 are 1.07e-06 kg/mm^3"),
        ({"density": 1.07}, "1.07 g/cm^3 are 1.07e-06 kg/mm^3"),
        ({"density": None, "mass": 8.0}, "finger.mass = 8 kg: makes 0.00104 kg/mm^3 of 7.7e+03 mm^3"),
    ],
)  # fmt: skip
def test_soft_body_with_implausible_numbers(block: Callable[..., str], changes: dict[str, Any], line: str) -> None:
    mesh = block((3, 3, 3), (20.0, 20.0, 20.0), hollow=True)
    assert told(soft(mesh)) == []
    given = {key: value for key, value in soft(mesh, **changes)["soft_bodies"]["finger"].items() if value is not None}
    (warning,) = told({"soft_bodies": {"finger": given}})
    assert line in warning


def test_shut_air_that_no_rubber_holds(block: Callable[..., str]) -> None:
    """5/6 of 300 kPa."""
    mesh = block((3, 3, 3), (30.0, 20.0, 20.0), hollow=True)
    for pressure, count in ((249.0, 0), (251.0, 1)):
        cavity = {"group": "cavity", "air": "sealed", "shut_pressure": pressure}
        warned = told(soft(mesh, cavities={"cavity": cavity}))
        assert len(warned) == count and all("holds more than 250 kPa" in line for line in warned)


@pytest.mark.parametrize(("length", "meant"), [(0.02, "0.02 m are 20 mm"), (0.25, "0.25 m are 250 mm")])
def test_mesh_in_metres(block: Callable[..., str], length: float, meant: str) -> None:
    (warning,) = told(soft(block((2, 2, 2), (length, 0.5 * length, 0.5 * length))))
    assert f"soft_bodies.finger.mesh: its longest side = {length} mm: soft robots have 1 to 20000; {meant}" in warning


def test_request_in_another_unit_is_told_once(block: Callable[..., str]) -> None:
    """30 kPa and 300 kPa given in Pa, whatever limits hold back; once in all steps and equilibria."""
    anchors = [{"box": [[-11, -11, -11], [11, 11, -9.99]]}]
    mesh, cavities = block((4, 4, 4), (20.0, 20.0, 20.0), hollow=True), {"air": {"group": "cavity"}}
    scene = {**soft(mesh, cavities=cavities, anchors=anchors), "limits": {"highest_pressure": 2.0}}
    for control, line in (
        (
            Control(pressure={"finger.air": 3e4}),
            "control.pressure['finger.air'] = 30000 kPa: soft robots have 0 to 2000",
        ),
        (Control(young_modulus={"finger": 3e5}), "; 300000 Pa are 300 kPa"),
    ):
        simulation = Simulation(scene_from_dict(scene))
        with warnings.catch_warnings(record=True) as seen:
            warnings.simplefilter("always")
            simulation.step(Control(pressure={"finger.air": 1.0}))
            assert not seen
            simulation.step(control)
            equilibrium(simulation, control)
        (warning,) = (str(one.message) for one in seen)
        assert line in warning


@pytest.mark.parametrize(
    ("modulus", "pressure", "hint"),
    [
        (300.0, 3e5, "300000 kPa: soft robots have 0 to 2000; 300000 Pa are 300 kPa; try kPa"),
        (0.6, 30.0, "50 times its"),
    ],
)
def test_explosion_names_mistaken_unit(block: Callable[..., str], modulus: float, pressure: float, hint: str) -> None:
    """A pressure in Pa, and a modulus in MPa."""
    anchors = [{"box": [[-11, -11, -11], [11, 11, -9.99]]}]
    mesh, cavities = block((4, 4, 4), (20.0, 20.0, 20.0), hollow=True), {"air": {"group": "cavity"}}
    scene = soft(mesh, cavities=cavities, anchors=anchors, young_modulus=modulus)
    simulation = Simulation(scene_from_dict(scene))
    with pytest.raises(SimulationDiverged, match=re.escape(hint)):
        for _ in range(20):
            simulation.step(Control(pressure={"finger.air": pressure}))


@pytest.mark.parametrize(
    ("scene", "line"),
    [
        (rigid(mass=50.0), "rigid_bodies.cube.mass = 50 kg: makes 0.000781 kg/mm^3 of 6.4e+04 mm^3"),
        (rigid(mass=50.0), "50 g are 0.05 kg"),
        (
            {**rigid(), "obstacles": {"post": {"box": [0.1, 0.02, 0.02], "translation": [0.0, 99.0, 0.0]}}},
            "obstacles.post: its longest side = 0.1 mm: soft robots have 1 to 20000; 0.1 m are 100 mm",
        ),
        (rigid(mass=None, density=2.7), "2.7 g/cm^3 are 2.7e-06 kg/mm^3"),
        ({**rigid(), "time": {"step": 10.0}}, "time.step = 10 s: soft robots have 1e-07 to 0.5; 10 ms are 0.01 s"),
        ({**rigid(), "gravity": [0.0, 0.0, -9.81]}, "gravity = 9.81 mm/s^2: soft robots have 50 to 1e+06; 9.81 m"),
        ({**rigid(), "time": {"duration": 1e7}}, "time.duration = 1e+07 s"),
    ],
)  # fmt: skip
def test_rigid_scene_with_implausible_numbers(scene: dict[str, Any], line: str) -> None:
    assert told(rigid()) == []
    (warning,) = told(scene)
    assert line in warning


@pytest.mark.parametrize(
    ("scene", "line"),
    [
        (rigid(mass=1e300), "less than or equal to 1"),
        (rigid(mass=1e15), "rigid_bodies.cube.mass = 1e+15 kg: makes"),
        (rigid(box=[1e-300] * 3), "must be 1e-18 or more"),
        (rigid(position=[0.0, 1e200, 0.0]), "less than or equal to 1"),
        (rigid(box=[1e-12] * 3, mass=1e-17), "its longest side = 1e-12 mm"),
        ({**rigid(), "time": {"step": 1e-17}}, "time.step = 1e-17 s"),
        (
            {**rigid(), "obstacles": {"floor": {"plane": {"point": [0.0] * 3, "normal": [0.0, 1e-200, 0.0]}}}},
            "normal: [0.0, 1e-200, 0.0] has no direction",
        ),
        (
            rigid(inertia=[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 2.1]]),
            "no body has it; the largest principal moment, 2.1 kg mm^2, must not exceed the sum of the others, 2",
        ),
    ],
)
def test_absurd_numbers_are_refused(scene: dict[str, Any], line: str) -> None:
    with pytest.raises(SceneError) as refused:
        told(scene)
    assert line in str(refused.value)


def test_flat_plate_has_inertia_at_limit() -> None:
    """Without thickness the largest principal moment is the sum of the others."""
    assert told(rigid(inertia=[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 2.0]])) == []


def test_body_of_two_pieces(block: Callable[..., str], tmp_path: Any) -> None:
    one = read_volume_mesh(block((1, 1, 1), (10.0, 10.0, 10.0)))
    nodes = np.vstack([one.nodes, one.nodes + np.array([30.0, 0.0, 0.0])])
    elements = np.vstack([one.elements, one.elements + len(one.nodes)])
    write_volume_mesh(VolumeMesh("two", nodes, elements, {}, {}), tmp_path / "two.msh")
    (warning,) = told(soft(str(tmp_path / "two.msh")))
    assert "has 2 pieces that nothing holds together" in warning


def test_pressures_of_a_network_in_pascals_are_named(block: Callable[..., str]) -> None:
    body = {"mesh": block((3, 3, 3), (20.0, 20.0, 20.0), hollow=True), "mass": 0.01, "young_modulus": 500}
    body |= {"poisson_ratio": 0.3, "cavities": {"air": {"group": "cavity", "air": "network"}}}
    air = {
        "sources": {"pump": {"pressure": 5e4}},
        "tubes": {"tube": {"inlet": "pump", "outlet": "block.air", "length": 9.0, "diameter": 1.0}},
    }
    with pytest.warns(UserWarning, match=r"air.sources.pump.pressure = 50000 kPa"):
        Simulation(scene_from_dict({"soft_bodies": {"block": body}, "air": air}))
