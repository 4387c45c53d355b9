"""Optimisation along gradients: moves of meshes with dimensions, gradients of runs by them, and the search itself."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blocks import make_block
from conftest import Figures
from hypothesis import given, settings
from hypothesis import strategies as some
from studies import Here

from taichisoft import Control, Controller, Observation, VolumeMesh, hookimpl, register_plugin
from taichisoft.mesh import element_volumes
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.running import Geometry, unregister_plugin
from taichisoft_studies.errors import StudyError
from taichisoft_studies.optimiser import Optimisation, best_trials, open_study
from taichisoft_studies.run_job import RunJob, make_run
from taichisoft_studies.shape_search import Shape, gradient_request, moves_of_nodes, run_descent
from taichisoft_studies.study_file import check_study

pytestmark = pytest.mark.usefixtures("taichisoft_plugins")


def wedge(length: float, cells: tuple[int, int, int]) -> VolumeMesh:
    """A body whose sides across y lean: 10 mm wide at the low end of z, and 10 mm + length / 10 at the other."""
    mesh = make_block(cells, (length, 10.0, 8.0))
    wider = 1.0 + 0.01 * length * (mesh.nodes[:, 2] / 8.0 + 0.5)
    return replace(mesh, nodes=mesh.nodes * np.column_stack([np.ones_like(wider), wider, np.ones_like(wider)]))


@settings(max_examples=10, deadline=None)
@given(length=some.floats(10.0, 60.0), cells=some.tuples(*[some.integers(1, 4)] * 3), more=some.integers(1, 5))
def test_faces_move_as_their_drawing_does(length: float, cells: tuple[int, int, int], more: int) -> None:
    """Of meshes with other nodes: the volume 8 l (10 + l / 20) grows by 80 + 0.8 l, and no node leaves its faces."""
    half, body = 1e-3, wedge(length, cells)
    move = moves_of_nodes(body, wedge(length + half, (more, 2, 1)), wedge(length - half, (3, more, 2)), half)
    sides = [element_volumes(body.nodes + sign * half * move, body.elements).sum() for sign in (1.0, -1.0)]
    assert (sides[0] - sides[1]) / (2.0 * half) == pytest.approx(80.0 + 0.8 * length, rel=1e-6)
    ends = np.abs(body.nodes[:, 0]) > 0.5 * length - 1e-9
    np.testing.assert_allclose(move[ends, 0], 0.5 * np.sign(body.nodes[ends, 0]), atol=1e-6)


def test_faces_that_come_or_stay_are_refused() -> None:
    body, hollow = make_block((3, 3, 3), (9.0, 9.0, 9.0)), make_block((3, 3, 3), (9.0, 9.0, 9.0), hollow=True)
    with pytest.raises(StudyError, match="its surface changes from 6 to 12 flat faces"):
        moves_of_nodes(body, hollow, body, 0.1)
    with pytest.raises(StudyError, match="it moves no surface of the mesh"):
        moves_of_nodes(body, make_block((4, 2, 2), (9.0, 9.0, 9.0)), body, 0.1)


class Bar(Geometry):
    """A bar that the mesher cuts into as many cells as its length asks for."""

    def __init__(self, tables: Mapping[str, Any], file: Path):
        self.tables = tables

    def mesh(self, size: float | None = None) -> VolumeMesh:
        length = self.tables["length"]
        mesh = make_block((2 * round(length) - 100, 2, 2), (length, self.tables["height"], 10.0))
        return replace(mesh, nodes=mesh.nodes + np.array([length / 2, 0.0, 0.0]))


class Heedful(Controller):
    """Follows the cube."""

    def control(self, observation: Observation) -> Control:
        return Control(base_translation=observation.object_positions["cube"] - [0.0, 0.0, 5.2])


class Bars:
    @hookimpl
    def taichisoft_controllers(self) -> Mapping[str, Any]:
        return {"heedful": Heedful}

    @hookimpl
    def taichisoft_geometry_kinds(self) -> Mapping[str, Any]:
        return {"bar": Bar}


@pytest.fixture
def bars(taichisoft_plugins: None) -> Iterator[None]:
    name = register_plugin(Bars())
    yield
    unregister_plugin(name)


SCENE = """
gravity = [0.0, -9810.0, 0.0]
time = { step = 0.02, duration = 0.1 }
controller = { name = "scripted", settings = { script = "rest" } }
[soft_bodies.bar]
mesh = "bar.toml"
element = "smoothed"
density = 1e-6
young_modulus = 100.0
poisson_ratio = 0.3
anchors = [{ box = [[-0.1, -50.0, -50.0], [0.1, 50.0, 50.0]] }]
rotation = [0.0, 90.0, 0.0]
translation = [5.0, 0.0, 0.0]
"""
LENGTH, HEIGHT, MODULUS = "length", "height", "soft_bodies.bar.young_modulus"


def search_of(folder: Path, **tables: Any) -> Optimisation:
    """A search for the bar whose tip sinks by 4 mm, which is to be light."""
    (folder / "bar.toml").write_text('kind = "bar"\nlength = 60.5\nheight = 10.0\n')
    (folder / "bar-scene.toml").write_text(SCENE)
    base = {
        "scene": str(folder / "bar-scene.toml"),
        "sampler": "gradient",
        "variables": {
            LENGTH: {"low": 55.0, "high": 75.0},
            HEIGHT: {"low": 8.0, "high": 12.0},
            MODULUS: {"low": 50.0, "high": 400.0, "log": True},
        },
        "objectives": {
            "miss": {
                "minimise": "(final_tip_positions_mm['bar'][1] + 4) ** 2 + (rest_volumes_mm3['bar'] / 6000 - 1) ** 2 "
                "+ (parameters['length'] / 60 - 1) ** 2"
            }
        },
        "trials": 14,
    }
    return check_study(Optimisation, {**base, **tables}, "study")


def made(shape: Shape, values: Mapping[str, float]) -> Mapping[str, Any]:
    job: RunJob = shape.runs(values).jobs[""]
    record = make_run(job)
    assert record["status"] == "completed", record["message"]
    return record["metrics"]


@pytest.mark.usefixtures("bars")
def test_gradient_by_dimensions_agrees_with_differences(tmp_path: Path, figures: Figures) -> None:
    """Of runs on the moved mesh, over 1e-5 of each variable, with the anchors moving along."""
    study = search_of(tmp_path)
    values = {LENGTH: 60.5, HEIGHT: 10.0, MODULUS: 120.0}
    shape = Shape(study, tmp_path, values, gradient_request(study))
    assert list(shape.moves) == [LENGTH, HEIGHT], "in the order of the study, or a search goes on with other bits"

    def miss(changed: Mapping[str, float]) -> float:
        m, all_of_it = made(shape, {**values, **changed}), {**values, **changed}
        sunk, light = m["final_tip_positions_mm"]["bar"][1] + 4.0, m["rest_volumes_mm3"]["bar"] / 6000.0 - 1.0
        return float(sunk**2 + light**2 + (all_of_it[LENGTH] / 60.0 - 1.0) ** 2)

    slopes = made(shape, values)["gradient"]
    for key, value in values.items():
        sides = [miss({key: (1.0 + sign * 1e-5) * value}) for sign in (1.0, -1.0)]
        expected = (sides[0] - sides[1]) / (2e-5 * value)
        figures.close(f"gradient by {key}", slopes[key], expected, 1e-6 * abs(expected))


@pytest.mark.usefixtures("bars")
def test_parameters_at_zero_and_of_any_size_have_slopes(tmp_path: Path) -> None:
    """Those of log(density) + 3 damping are 1 / density, of 1e-6 kg/mm^3, and 3, at a damping of its lowest value."""
    density, damping = "soft_bodies.bar.density", "soft_bodies.bar.rayleigh_stiffness"
    study = search_of(
        tmp_path,
        variables={density: {"low": 5e-7, "high": 2e-6, "log": True}, damping: {"low": 0.0, "high": 0.1}},
        objectives={"x": {"minimise": f"log(parameters['{density}']) + 3 * parameters['{damping}']"}},
    )
    values = {density: 1.1e-6, damping: 0.0}
    slopes = made(Shape(study, tmp_path, values, gradient_request(study)), values)["gradient"]
    assert slopes == pytest.approx({density: 1.0 / 1.1e-6, damping: 3.0}, rel=1e-6)


@pytest.mark.usefixtures("bars")
def test_dimensions_that_the_study_sets_hold(tmp_path: Path) -> None:
    """Of a bar with no variable dimension."""
    variables = {MODULUS: {"low": 50.0, "high": 400.0}}
    study = search_of(
        tmp_path, variables=variables, objectives={"x": {"minimise": "unconverged_steps"}}, set=[f"{LENGTH}=70.0"]
    )
    shape = Shape(study, tmp_path, {MODULUS: 120.0}, {"objective": "rest_volumes_mm3['bar']", "figures": {}})
    assert made(shape, {MODULUS: 120.0})["rest_volumes_mm3"]["bar"] == pytest.approx(7000.0)


class OneAtATime(Here):
    count = 1


def searched(study: Optimisation, folder: Path) -> tuple[Any, OneAtATime]:
    trials, workers = open_study(study, folder), OneAtATime()
    trials.set_user_attr("folder", str(folder))
    run_descent(study, folder, trials, workers, lambda trial, record: None)
    return trials, workers


@pytest.mark.usefixtures("bars")
def test_search_along_gradients_finds_optimum_and_goes_on(tmp_path: Path) -> None:
    """It meets all three aims at once; a search that was ended goes on with the trials of one that was not."""
    whole, _ = searched(search_of(tmp_path), tmp_path / "whole")
    (best,) = best_trials(whole, 1)
    assert best.value < 1e-2 * whole.trials[0].value
    assert len({trial.params[LENGTH] for trial in whole.trials}) > 2
    ended, _ = searched(search_of(tmp_path, trials=3), tmp_path / "ended")
    assert len(ended.trials) == 3
    again, workers = searched(search_of(tmp_path), tmp_path / "ended")
    assert [trial.params for trial in again.trials] == [trial.params for trial in whole.trials]
    assert len(workers.made) == len(whole.trials) - 3


@pytest.mark.parametrize(
    ("tables", "expected"),
    [
        ({"objectives": {"x": {"minimise": "max_penetration_mm"}}}, "'max_penetration_mm' has no gradient here; there"),
        (
            {"variables": {"time.step": {"low": 0.01, "high": 0.02}}},
            "time.step: has no gradient here, since it changes",
        ),
        ({"variables": {LENGTH: [60.0, 61.0]}}, "real variables; without constraints, pruning, scenes, lists and int"),
        ({"start": {LENGTH: 90.0}}, "start.length = 90.0: must be a number from 55 to 75"),
        ({"start": {LENGTH: "60"}}, "start.length = '60': must be a number from 55 to 75"),
        ({"objectives": {"x": {"minimise": "0 * parameters['length']"}}}, "the objective changes with no variable"),
        ({"constraints": {"low": "total <= 1"}}, "knows one objective, an expression of one run"),
    ],
)
@pytest.mark.usefixtures("bars")
def test_searches_without_gradient_are_refused(tmp_path: Path, tables: dict[str, Any], expected: str) -> None:
    with pytest.raises(StudyError, match=expected) as refused:
        searched(search_of(tmp_path, **tables), tmp_path / "out")
    assert "\n" not in str(refused.value)


@pytest.mark.usefixtures("bars")
def test_controller_that_heeds_the_run_is_refused(tmp_path: Path) -> None:
    study = check_study(
        Optimisation,
        {
            "scene": str(TINY_GRIPPER),
            "controller": "heedful",
            "sampler": "gradient",
            "variables": {"contact.friction": {"low": 0.1, "high": 0.9}},
            "objectives": {"x": {"minimise": "final_pressures_kPa['left.cavity']"}},
        },
        "study",
    )
    with pytest.raises(StudyError, match="depends on time alone"):
        searched(study, tmp_path)
