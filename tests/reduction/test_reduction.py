"""Reduced models: forces of domains, modes, weights, the frame of the base, and what is refused."""

import json

import numpy as np
import pytest
import scipy.optimize
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from taichisoft import Control, Simulation, load_scene, make_model, scene_from_dict
from taichisoft.mechanics import FramePlaces, Modes
from taichisoft.mechanics.elasticity import internal_force
from taichisoft.scene import scene_to_toml
from taichisoft_reduction.body_shapes import RelativeMotion, body_shapes
from taichisoft_reduction.errors import ReductionError
from taichisoft_reduction.reduce_command import reduce
from taichisoft_reduction.reduced_check import ReducedCheckOutput
from taichisoft_reduction.shape_fit import Basis, DomainForces, DomainSearch, MotionCriterion, NonNegativeSearch
from taichisoft_reduction.shape_reduction import Wishes, _drives, find_mode_count, reduce_scene
from taichisoft_reduction.training_plan import presses
from taichisoft_reduction.training_run import Progress, RunResult, Timetable, TrainingRun, TrainingRuns
from taichisoft_reduction.validation import compare, error_per_imbalance, largest_imbalance, worst

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
def test_domains_have_the_forces_of_the_engine(block, law):
    """f_r = Phi^T f, to rounding: the same law, computed by kernels in space and by numpy in the mesh's frame."""
    model = make_model(beam(block, **law))
    (body,) = model.soft_bodies
    modes = random_modes(body, 5) * ~body.anchored[:, None, None]
    forces = DomainForces(body, modes)
    amplitudes = np.array([3.0, -2.0, 1.0, 2.0, -1.0])
    turn = Rotation.from_euler("xyz", TURNED["rotation"], degrees=True).as_matrix()
    moved = body.rest_position + (modes @ amplitudes) @ turn.T
    expected = np.einsum("nir,ni->r", modes, internal_force(model.elasticity, moved) @ turn)
    assert -forces.forces(amplitudes).sum(axis=0) == pytest.approx(expected, rel=1e-8)


def test_the_stiffness_is_the_slope_of_the_forces_at_rest(block):
    """At rest the corotated stiffness by the moduli at rest is the tangent of every law: df = K dq."""
    (body,) = make_model(beam(block, element="smoothed", law="yeoh", coefficients={"c10": 20.0})).soft_bodies
    forces = DomainForces(body, random_modes(body, 6))
    small = 1e-6 * np.eye(6)
    slopes = [(forces.forces(step) - forces.forces(-step)).sum(axis=0) / 2e-6 for step in small]
    assert np.array(slopes) + forces.anchor == pytest.approx(forces.stiffness(np.zeros(6)), rel=1e-5)


def test_spin_forces_are_those_of_the_frozen_stiffness(block):
    """Damping K v of a spin v = w x X: by modes that are this spin, K_d v is the spin's force on each mode."""
    (body,) = make_model(beam(block, element="linear", young_modulus=100.0, anchors=[])).soft_bodies
    spin = np.array([0.3, -0.5, 0.8])
    stretched = np.array([0.1, 0.02, -0.03]) * body.mesh.nodes
    modes = np.stack([stretched, np.cross(spin, body.mesh.nodes + stretched)], axis=2)
    forces = DomainForces(body, modes)
    state = np.array([1.0, 0.0])
    expected = forces.stiffness(state)[:, 1]
    assert forces.spin_forces(state, spin).sum(axis=0) == pytest.approx(expected, rel=1e-9, abs=1e-9 * expected[1])
    assert expected[1] > 0.0


def test_modes_are_orthonormal_in_the_mass_and_hold_the_training():
    """Phi^T M Phi = 1, and all modes give the displacements back; fewer modes hold them less well."""
    rng = np.random.default_rng(1)
    mass = rng.uniform(0.5, 2.0, 12)
    patterns = rng.standard_normal((4, 12, 3))
    basis = Basis(np.einsum("sk,knd->snd", rng.standard_normal((20, 4)) * [8.0, 4.0, 1.0, 0.3], patterns), mass)
    flat = basis.modes.reshape(36, -1)
    assert flat.T @ (np.repeat(mass, 3)[:, None] * flat) == pytest.approx(np.eye(flat.shape[1]), abs=1e-9)
    errors = [basis.error(count) for count in (1, 2, 3, 4)]
    assert errors == sorted(errors, reverse=True) and errors[3] < 1e-6 < errors[2]
    assert basis.count_for(1e-4) == 4


@pytest.mark.parametrize(("needed", "enough"), [(20, 20), (25, 25), (30, 31), (40, 47), (60, 47)])
def test_mode_count_is_bisected(needed, enough):
    class Fit:
        mode_count = 20

        def use_modes(self, count):
            self.mode_count = count

    fit, tried = Fit(), []

    def is_followed():
        tried.append(fit.mode_count)
        return fit.mode_count >= needed

    find_mode_count(fit, is_followed)
    assert fit.mode_count == enough
    assert len(tried) == len(set(tried)) <= 4


def test_training_without_motion_is_refused():
    with pytest.raises(ReductionError, match="nothing moved"):
        Basis(np.zeros((5, 8, 3)), np.ones(8))


@examples(25)
@given(st.integers(0, 10**6))
def test_weights_are_the_non_negative_least_squares(seed):
    """At the end of the search the residual is the one of scipy's solver, and no weight is negative."""
    rows = np.random.default_rng(seed).standard_normal((12, 30)).astype(np.float32)
    rows[:, :3] += 1.0
    search = NonNegativeSearch(rows)
    for _ in range(60):
        if not search.grow(4):
            break
    assert (search.weight > 0.0).all()
    target = rows.sum(axis=1, dtype=np.float64)
    missed = np.linalg.norm(rows[:, search.chosen] @ search.weight - target)
    assert missed <= scipy.optimize.nnls(rows.astype(float), target)[1] + 1e-3


def test_search_goes_on_to_the_smallest_parts():
    """Weights of 1 are exact, so that the residual falls to rounding, however much the columns resemble each other."""
    rng = np.random.default_rng(0)
    parts = rng.standard_normal((120, 120)) * np.logspace(0.0, -5.0, 120)
    search = NonNegativeSearch((1.0 + parts @ rng.standard_normal((120, 400))).astype(np.float32))
    target = search.residual
    while search.residual > 1e-7 * target:
        assert search.grow(4) and len(search.chosen) < 150


def test_chosen_domains_move_a_beam_as_all_do(block):
    """Fewer domains than there are, within the error that is allowed, on states they were not chosen by, too."""
    scene = beam(block, element="smoothed", young_modulus=100.0)
    model = make_model(scene)
    (body,) = model.soft_bodies
    states = []
    for direction in np.vstack([np.eye(3), -np.eye(3)]):
        simulation = Simulation(model)
        for _ in range(12):
            simulation.step(Control(gravity=30000.0 * direction))
            states.append(
                RelativeMotion.of_body(body).displacement(simulation.state.position, model.places(simulation.state), 0)
            )
    basis = Basis(np.array(states), body.node_mass)
    forces = DomainForces(body, basis.modes[:, :, :6])
    amplitudes = basis.amplitudes[:, :6]
    criterion = MotionCriterion(forces, amplitudes[::2], amplitudes[:1], 0.01)
    allowed = 0.01 * basis.largest
    chosen = DomainSearch(criterion, forces.volume).until(allowed)
    assert chosen.error <= allowed and len(chosen.domain) < 0.6 * forces.count
    unseen = MotionCriterion(forces, amplitudes[1::2], amplitudes[:1], 0.01)
    assert unseen.error(chosen.domain, chosen.weight) < 3.0 * allowed


@examples(40)
@given(st.lists(st.floats(-3.0, 3.0), min_size=6, max_size=6))
def test_motion_of_the_frame_is_no_displacement(values):
    """Turn and shift of the frame are taken out, and the placement of the body, whatever they are."""
    nodes = np.random.default_rng(2).standard_normal((6, 3))
    placed = RelativeMotion(nodes, [10.0, 50.0, -70.0], [1.0, 2.0, 3.0])
    turn = Rotation.from_euler("xyz", [10.0, 50.0, -70.0], degrees=True).as_matrix()
    bent = nodes + 0.3 * nodes[::-1]
    shift, vector = np.array(values).reshape(2, 3)
    frame = Rotation.from_rotvec(vector).as_matrix()
    places = FramePlaces(np.array([np.eye(3), frame]), np.array([np.zeros(3), shift]))
    position = (bent @ turn.T + [1.0, 2.0, 3.0]) @ frame.T + shift
    assert placed.displacement(position, places, 1) == pytest.approx(bent - nodes, abs=1e-12)


def test_copies_share_a_shape_and_other_materials_do_not():
    tiny = {"mesh": "tutorial-coarse", "mass": 0.01, "young_modulus": 100.0, "poisson_ratio": 0.3, "anchors": ANCHORS}
    bodies = {"a": tiny, "b": {**tiny, **TURNED}, "c": {**tiny, "young_modulus": 90.0}, "free": {**tiny, "anchors": []}}
    shapes = body_shapes(scene_from_dict({"soft_bodies": bodies}))
    assert [shape.bodies for shape in shapes] == [("a", "b"), ("c",)]


def run_result(**changes):
    values = {
        "name": "run",
        "problem": "",
        "time": np.array([0.1, 0.2]),
        "figures": {"lift of cube [mm]": np.arange(2.0)},
    }
    return RunResult(**{**values, "displacement": {"a": np.zeros((2, 4, 3))}, **changes})


def test_comparison_has_the_largest_error(tmp_path):
    other = np.zeros((2, 4, 3))
    other[1, 2] = [0.0, 3.0, 4.0]
    comparison = compare(run_result(displacement={"a": 10.0 * other}), run_result(displacement={"a": 9.0 * other}))
    assert comparison.deviations["position"].largest == pytest.approx(5.0)
    assert worst([comparison]) == pytest.approx(0.1)
    assert worst([compare(run_result(), run_result(problem="it diverged"))]) == float("inf")
    run_result().save(tmp_path / "run.npz")
    assert RunResult.load(tmp_path / "run.npz").figures["lift of cube [mm]"].tolist() == [0.0, 1.0]
    (tmp_path / "half.npz").write_bytes((tmp_path / "run.npz").read_bytes()[:300])
    assert RunResult.load(tmp_path / "half.npz") is None


def test_error_per_imbalance_is_the_largest():
    """Errors of 0.5 and 0.2 mm beside imbalances of 0.1 and 0.02 mm: ratios of 5 and 10; another body counts not."""
    pairs = []
    for error, imbalance in ((0.5, 0.1), (0.2, 0.02)):
        away = np.zeros((2, 4, 3))
        away[1, 2, 0] = error
        both = {"a": np.zeros((2, 4, 3)), "b": np.zeros((2, 4, 3))}
        figures = {"imbalance of a [mm]": np.array([0.0, imbalance]), "imbalance of b [mm]": np.array([0.0, 1e-9])}
        full, reduced = run_result(displacement=both), run_result(displacement={**both, "a": away}, figures=figures)
        pairs.append((full, reduced))
    assert error_per_imbalance(pairs, ["a"]) == pytest.approx(10.0)
    assert error_per_imbalance(pairs, ["c"]) == 0.0
    assert largest_imbalance(pairs[0][1], ["a", "b", "c"]) == 0.1


def test_reduced_check_finds_where_models_part(block, tmp_path):
    """Two modes of a beam under its weight: the check has the errors of two runs of their own, and from when on."""
    scene = beam(block, element="linear", young_modulus=100.0, density=1e-5)
    full = Simulation(scene)
    body = full.model.soft_bodies[0]
    weight = np.sqrt(np.repeat(body.node_mass, 3))[:, None]
    along = np.where(body.anchored, 0.0, body.mesh.nodes[:, 0])[:, None]
    shapes = np.stack([along**2 * np.eye(3)[n] for n in (1, 2)], axis=2).reshape(-1, 2)
    columns = (np.linalg.qr(weight * shapes)[0] / weight).reshape(-1, 3, 2)
    Modes(body.mesh.nodes, columns, fingerprint=body.fingerprint, tolerance=0.01).write(tmp_path / "beam.npz")
    reduced = Simulation(
        scene.model_copy(
            update={"soft_bodies": {"beam": body.settings.model_copy(update={"reduced": str(tmp_path / "beam.npz")})}}
        )
    )
    check = ReducedCheckOutput(tmp_path, "2%")
    check.begin(reduced.model, reduced.state)
    away = []
    for _ in range(6):
        control = Control(gravity=[0.0, 0.0, -9810.0], base_translation=np.array([0.0, 1.0, 0.0]))
        report = reduced.step(control)
        check.record(reduced.state, report)
        full.step(control)
        if full.state.step % 2 == 0:
            away.append(float(np.linalg.norm(full.state.position - reduced.state.position, axis=1).max()))
    check.end("completed")
    (parting,) = (row for row in check.partings() if row.quantity == "position")
    assert (parting.of, parting.largest, parting.time) == ("beam", max(away), pytest.approx(0.06))
    above = [2 * (n + 1) * 0.01 for n, error in enumerate(away) if error > 0.02 * parting.scale]
    assert parting.parted == pytest.approx(above[0])
    assert (
        f"of beam at 0.06 s; beyond the tolerance from {above[0]:.2f} s on"
        in check.summary()["position: reduced from full"]
    )
    assert json.loads((tmp_path / "reduced_check.json").read_text())["quantities"][0]["largest"] == parting.largest
    with pytest.raises(ReductionError, match="--reduced-check: no soft body of the scene is reduced"):
        ReducedCheckOutput(tmp_path).begin(full.model, full.state)


def test_every_place_of_the_pad_is_pressed(block):
    """A beam that bends down: where a plane or a box would touch it at rest, something else meets the same place."""
    ends = {
        "rotation": [0.0, 0.0, 0.0],
        "translation": [0.0, 0.0, 0.0],
        "anchors": [{"box": [[-11, -9, -9], [-9, 9, 9]]}],
    }
    mesh = block((20, 2, 1), (20.0, 5.0, 5.0))
    (body,) = make_model(beam(block, mesh=mesh, young_modulus=100.0, **ends)).soft_bodies
    time = np.linspace(0.0, 0.8, 21)
    bent = np.zeros((21, *body.rest_position.shape))
    bent[:, :, 2] = -np.outer(time / 0.8, (body.rest_position[:, 0] + 10.0) ** 2) / 40.0
    bent[:, :, 0] = 0.6 * bent[:, :, 2]
    ramp = RunResult("ramp", "", time, {"beam": bent}, {})
    nowhere = np.zeros(len(body.rest_position), bool)
    obstacles = presses(body, ramp, nowhere, 0.1, unseen=False)
    kinds = set().union(*(press.obstacle for press in obstacles))
    assert {"sphere", "box", "cylinder"} <= kinds
    assert len(obstacles) == 10
    assert all(press.normal[2] < -0.5 for press in obstacles)


def test_drives_cover_all_copies():
    """From the lowest to the highest over runs that came to their end; what stood still is not known."""
    (shape,) = body_shapes(load_scene("gripper"))

    def result(problem="", **pressures):
        drives = {f"{name}.cavity": ("pressure", *value) for name, value in pressures.items()}
        return RunResult("run", problem, np.zeros(0), {}, {}, drives=drives)

    results = [result(finger1=(0.0, 30.0)), result(finger2=(-5.0, 10.0)), result("ended early", finger1=(0.0, 90.0))]
    assert _drives(shape, results) == {"cavity": ("pressure", -5.0, 30.0)}
    assert _drives(shape, [result(finger1=(2.0, 2.0))]) == {}


def test_other_request_has_another_file():
    run = TrainingRun("run", "scene", ("a",), 1.0, Timetable((0.0, 1.0), {"pressure/a.b": (0.0, 1.0)}))
    other = TrainingRun("run", "scene", ("a",), 1.0, Timetable((0.0, 1.0), {"pressure/a.b": (0.0, 2.0)}))
    assert run.file_name != other.file_name


def test_runs_in_the_folder_are_not_made_again(block, tmp_path):
    """A run that was begun to fill a process counts when it is waited for; the next command reads all from files."""
    scene = scene_to_toml(beam(block, element="linear", young_modulus=100.0))
    tables = [Timetable((0.0, 0.1), {"gravity/z": (0.0, -gravity)}) for gravity in (9810.0, 5000.0)]
    heavy, light = (TrainingRun("run", scene, ("beam",), 0.04 * (1 + n), table) for n, table in enumerate(tables))
    waits, costs = [], []

    class Counting(Progress):
        def runs(self, title, cost):
            waits.append((title, cost))
            return costs.append

    with TrainingRuns(tmp_path, 1, (), Counting()) as runs:
        runs.start([heavy])
        runs.results([light], "light")
        results = runs.results([heavy, light], "both")
    assert [len(result.time) for result in results] == [4, 8]
    assert sum(costs) == pytest.approx(sum(cost for _, cost in waits)) and waits[0] == ("light", light.cost)
    made = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    with TrainingRuns(tmp_path, 1, (), Counting()) as runs:
        runs.results([heavy, light], "again")
    assert waits[-1] == ("again", 0) and made == {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tolerance": "0"}, "--tolerance 0: must be a share"),
        ({"tolerance": "nan%"}, "--tolerance nan%: must be a share"),
        ({"modes": 0}, "--modes 0: must be at least 1"),
        ({"processes": 0}, "--processes 0: must be at least 1"),
        ({"own_training": False}, "--no-training: needs --runs"),
        ({"range_": ["a.tube=5:1"]}, "--range a.tube=5:1: must be BODY.ACTUATOR=LOW:HIGH"),
    ],
)
def test_wrong_options_are_refused(tmp_path, options, message):
    with pytest.raises(ReductionError, match=message):
        reduce(**{"scene": "gripper", "output": tmp_path, "modes": None, "tolerance": "1%", **OTHERS, **options})


OTHERS = {"runs": None, "own_training": True, "range_": None, "full_range": False, "processes": None, "set_": None}


def test_scene_without_anchors_is_refused(block, tmp_path):
    scene = beam(block, element="linear", young_modulus=100.0, anchors=[])
    with pytest.raises(ReductionError, match=r"no soft body of the scene has anchors \(soft bodies: beam\)"):
        reduce_scene(scene, tmp_path, Wishes(), Progress())


def test_a_body_between_frames_is_refused(block, tmp_path):
    """Of two copies that differ in what they follow, one would have its modes at another frame than its anchors."""
    body = beam(block, young_modulus=100.0).soft_bodies["beam"].model_dump(exclude_unset=True)
    held = {**body, "anchors": [{**anchor, "follows": "jaw"} for anchor in body["anchors"]]}
    other = {**held, "translation": [0.0, 50.0, 0.0]}
    scene = scene_from_dict(
        {"frames": {"jaw": {}}, "soft_bodies": {"first": {**held, "follows": "jaw"}, "second": other}}
    )
    with pytest.raises(ReductionError, match=r"soft_bodies\.second: its anchors follow other frames .* \('base'\)"):
        reduce_scene(scene, tmp_path, Wishes(), Progress())


def test_unknown_actuator_is_refused(block, tmp_path):
    scene = beam(block, element="linear", young_modulus=100.0)
    with pytest.raises(ReductionError, match=r"--range beam\.air: the scene has no such actuator; it has: none"):
        reduce_scene(scene, tmp_path, Wishes(ranges={"beam.air": (0.0, 1.0)}), Progress())
