"""The single finger against SOFA v25.06: the same equations, so the same numbers at every node and step.

Tolerance 1e-6 of the largest displacement: any wrong term leaves 1e-3 or more. Gravity alone leaves 2e-13; with
pressure the coarse runs leave 5e-10, most likely vertices of the cavity on faces between elements, which the two
programs embed in one or the other by round-off.
"""

from pathlib import Path

import numpy as np
import pytest
import tutorial
from conftest import Figures

from taichisoft import Control, Simulation, make_model
from taichisoft.mechanics.elasticity import internal_force

TOLERANCE = 1e-6

RUNS = [
    ("finger_coarse_gravity", tutorial.COARSE, 300),
    ("finger_coarse_10kPa", tutorial.COARSE, 210),
    ("finger_coarse_30kPa", tutorial.COARSE, 230),
    ("finger_coarse_50kPa", tutorial.COARSE, 250),
    ("finger_coarse_growth_1000mm3", tutorial.COARSE, 300),
    ("finger_coarse_50kPa_dt1ms", tutorial.COARSE, 1000),  # of 3000, for the time that they take
    ("finger_fine_30kPa", tutorial.FINE, 230),
]


@pytest.mark.parametrize(("name", "mesh", "steps"), RUNS, ids=[name for name, _, _ in RUNS])
def test_the_finger_follows_sofa(shared: Path, figures: Figures, name: str, mesh: str, steps: int) -> None:
    """Every node where SOFA's run has them all, else the tip, at every step; and every node at the end."""
    run = dict(np.load(shared / "reference" / f"{name}.npz"))
    step = float(run["dt"])
    simulation = Simulation(tutorial.finger_scene(shared, mesh, step))
    tip = int(run["tip_index"])
    largest = np.abs(run["x_final"] - run["x_rest"]).max()
    every_node = run.get("x_all")
    worst = worst_pressure = 0.0
    for k, value in enumerate(run["value"][:steps]):
        if "growth" in name:
            control = Control(volume_growth={"finger.cavity": float(value)})
        else:
            control = Control(pressure={"finger.cavity": float(value) / step})
        pressure = simulation.step(control).observation.pressures["finger.cavity"]
        position = simulation.state.position
        miss = position - every_node[k] if every_node is not None else position[tip] - run["tip"][k]
        worst = max(worst, np.abs(miss).max())
        worst_pressure = max(worst_pressure, abs(pressure - run["lambda_pressure"][k] / step))
    figures.at_most("worst step, of the largest displacement", worst / largest, TOLERANCE)
    figures.at_most("pressure, worst step [kPa]", worst_pressure, 1e-6)
    if steps == len(run["value"]):
        ours = np.abs(position - run["x_rest"]).max()
        figures.close("largest displacement at the end [mm]", ours, largest, TOLERANCE * largest)
        end = np.abs(position - run["x_final"]).max()
        figures.at_most("every node at the end, of the largest displacement", end / largest, TOLERANCE)


def test_internal_forces_are_those_of_sofa(shared: Path, figures: Figures) -> None:
    """f = -sum V R C:e(R^T x - X) g of the finger with every node moved by up to 0.5 mm.

    Tolerance 1e-9 of the largest force: two programs sum the same terms in another order (measured 1e-14).
    """
    run = np.load(shared / "reference" / "internal_force_coarse.npz")
    model = make_model(tutorial.finger_scene(shared))
    assert model.elasticity is not None
    force = internal_force(model.elasticity, run["x"])
    expected = run["F_step7_500_plus_1000"]
    scale = np.abs(expected).max()
    figures.at_most("largest difference / largest force", np.abs(force - expected).max() / scale, 1e-9)


@pytest.mark.parametrize("mesh", ["coarse", "fine"])
def test_selections_are_those_of_sofa(shared: Path, mesh: str) -> None:
    """The nodes and tetrahedra, the clamped nodes, the stiff layer's tetrahedra and the cavity's surface."""
    setup = np.load(shared / "reference" / f"finger_{mesh}_setup.npz")
    file = tutorial.COARSE if mesh == "coarse" else tutorial.FINE
    (body,) = make_model(tutorial.finger_scene(shared, file)).soft_bodies
    np.testing.assert_array_equal(body.rest_position, setup["nodes"])
    np.testing.assert_array_equal(body.elements, setup["tets"])
    np.testing.assert_array_equal(np.flatnonzero(body.anchored), np.sort(setup["fixed"]))
    stiff = np.flatnonzero(body.lame[:, 1] > body.lame[:, 1].min())
    np.testing.assert_array_equal(stiff, np.sort(setup["sub_tet_indices"]))
    (cavity,) = body.cavities
    assert len(cavity.surface.triangles) == len(setup["cavity_tri"])
