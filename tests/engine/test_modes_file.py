"""Files of modes that are not those of the body, and bodies that modes cannot move: one line each."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taichisoft import Control, Model, Scene, Simulation, make_model
from taichisoft.errors import ControlError, SceneError
from taichisoft.mechanics import Modes
from taichisoft.running import TrainingRange, with_reduced_bodies
from taichisoft.running.training_watch import TrainingWatch
from taichisoft.scene import scene_from_dict


@pytest.fixture
def body(block: Callable[..., str]) -> dict[str, Any]:
    anchors = [{"box": [[-50, -50, -50], [-9.9, 50, 50]]}]
    mesh = block((2, 1, 1), (20.0, 10.0, 10.0))
    return {"mesh": mesh, "density": 1e-6, "young_modulus": 500.0, "poisson_ratio": 0.3, "anchors": anchors}


def scene_of(body: dict[str, Any], **more: Any) -> Scene:
    return scene_from_dict({"soft_bodies": {"block": body}, **more})


def modes_of(model: Model, **changes: Any) -> Modes:
    """Stretching along x and bending to both sides."""
    (made,) = model.soft_bodies
    along = made.mesh.nodes[:, 0] + 10.0
    shapes = np.zeros((len(along), 3, 3))
    shapes[:, 0, 0], shapes[:, 1, 1], shapes[:, 2, 2] = along, along**2, along**2
    weight = np.sqrt(np.repeat(made.node_mass, 3))[:, None]
    basis = np.linalg.qr(weight * shapes.reshape(-1, 3))[0] / weight
    given = {"rest_position": made.mesh.nodes, "modes": basis.reshape(shapes.shape), "fingerprint": made.fingerprint}
    return Modes(**{**given, **changes})


def test_what_is_written_is_read(body: dict[str, Any], tmp_path: Path) -> None:
    model = make_model(scene_of(body))
    domains = {"domain": np.array([0, 3]), "weight": np.array([2.0, 4.0]), "amplitude_range": np.ones((3, 2))}
    known = {"tolerance": 0.01, "error": 0.005, "imbalance": 0.1, "error_per_imbalance": 20.0}
    known |= {"pressed": np.arange(12) % 2 > 0, "drives": '{"air": ["pressure", 0.0, 9.0]}'}
    written = modes_of(model, **domains, **known, report='{"a": 1}')
    written.write(tmp_path / "block.npz")
    (read,) = make_model(scene_of({**body, "reduced": str(tmp_path / "block.npz")})).soft_bodies
    assert read.modes is not None
    for name, value in vars(written).items():
        assert np.array_equal(getattr(read.modes, name), value), name


CHANGES: list[tuple[dict[str, Any], dict[str, Any], str]] = [
    ({"rest_position": np.zeros((12, 3))}, {}, "made of another mesh"),
    ({"rest_position": np.zeros((4, 3)), "modes": np.zeros((4, 3, 1))}, {}, "made of a mesh with 4 nodes"),
    ({"modes": np.ones((12, 3, 2))}, {}, "not orthonormal in the masses"),
    ({"modes": np.full((12, 3, 2), np.nan)}, {}, "modes has a value that is not finite"),
    ({"modes": np.ones((12, 2))}, {}, "modes has shape"),
    ({"domain": np.array([999]), "weight": np.ones(1)}, {}, "has domain 999, the body has"),
    ({"domain": np.array([1]), "weight": np.zeros(1)}, {}, "must be above 0"),
    ({"domain": np.array([1]), "weight": np.ones(2)}, {}, "weight has shape"),
    ({"domain": np.zeros(0), "weight": np.zeros(0)}, {}, "no integration domains"),
    ({"report": "{"}, {}, "not JSON"),
    ({"drives": '{"air": 3}'}, {}, "drives are not key, low and high"),
    ({}, {"poisson_ratio": 0.4}, "other materials"),
    ({}, {"element": "linear"}, "other materials"),
    ({}, {"density": 2e-6}, "another mass or density"),
    ({}, {"anchors": []}, "no anchors"),
]


@pytest.mark.parametrize(("file", "scene", "message"), CHANGES)
def test_modes_of_another_body_are_refused(
    body: dict[str, Any], tmp_path: Path, file: dict[str, Any], scene: dict[str, Any], message: str
) -> None:
    path = tmp_path / "block.npz"
    modes_of(make_model(scene_of(body)), **file).write(path)
    with pytest.raises(SceneError, match=message) as error:
        make_model(scene_of({**body, **scene, "reduced": str(path)}))
    assert "soft_bodies.block.reduced" in str(error.value)
    assert "\n" not in str(error.value)


def test_moduli_that_all_change_by_a_factor_do_not_matter(body: dict[str, Any], tmp_path: Path) -> None:
    modes_of(make_model(scene_of(body))).write(tmp_path / "block.npz")
    make_model(scene_of({**body, "young_modulus": 700.0, "reduced": str(tmp_path / "block.npz")}))


def test_files_that_are_none(body: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "block.npz"
    with pytest.raises(SceneError, match="no such file"):
        scene_of({**body, "reduced": str(path)})
    for content in (b"", b"not a zip file", b"PK\x03\x04 cut off"):
        path.write_bytes(content)
        with pytest.raises(SceneError, match="is not a file of modes"):
            make_model(scene_of({**body, "reduced": str(path)}))
    np.savez(path, modes=np.zeros((12, 3, 1)))
    with pytest.raises(SceneError, match="has no array 'rest_position'"):
        make_model(scene_of({**body, "reduced": str(path)}))


def test_moved_anchors_are_refused(body: dict[str, Any], tmp_path: Path) -> None:
    from taichisoft import Simulation

    modes_of(make_model(scene_of(body))).write(tmp_path / "block.npz")
    reduced = {**body, "reduced": str(tmp_path / "block.npz")}
    simulation = Simulation(scene_of(reduced))
    before = simulation.state
    places = before.anchor_position + np.array([0.0, 1.0, 0.0])
    with pytest.raises(ControlError, match="'block' is reduced"):
        simulation.step(Control(anchor_positions={"block": places}))
    assert simulation.state is before


def test_a_folder_of_modes_serves_copies(body: dict[str, Any], tmp_path: Path) -> None:
    modes_of(make_model(scene_of(body))).write(tmp_path / "one.npz")
    turned = {**body, "rotation": [90.0, 0.0, 0.0], "translation": [0.0, 40.0, 0.0]}
    stiffer = {**turned, "translation": [0.0, 80.0, 0.0], "poisson_ratio": 0.4}
    scene = scene_from_dict({"soft_bodies": {"one": body, "two": turned, "three": stiffer}})
    found = {name: one.reduced for name, one in with_reduced_bodies(scene, tmp_path).soft_bodies.items()}
    file = str((tmp_path / "one.npz").resolve())
    assert found == {"one": file, "two": file, "three": None}
    with pytest.raises(SceneError, match="has no modes of a soft body"):
        with_reduced_bodies(scene_of(body), tmp_path)
    with pytest.raises(SceneError, match="no such folder"):
        with_reduced_bodies(scene, tmp_path / "nowhere")


def test_beyond_the_training(body: dict[str, Any], tmp_path: Path) -> None:
    """Half as far again as in the training, wherever the base is."""
    from taichisoft.base.rotations import rotation_from_vector

    full = make_model(scene_of(body))
    trained = modes_of(
        full,
        amplitude_range=np.array([[0.0, 2.0], [-1.0, 1.0], [0.0, 0.0]]),
        tolerance=0.01,
        error=0.02,
        imbalance=0.01,
        error_per_imbalance=20.0,
    )
    trained.write(tmp_path / "block.npz")
    placed = {**body, "rotation": [10.0, 20.0, 30.0], "translation": [1.0, 2.0, 3.0]}
    model = make_model(scene_of({**placed, "reduced": str(tmp_path / "block.npz")}))
    watch, known = TrainingWatch(model), TrainingRange(model.soft_bodies, model.frames)
    state = model.initial_state()
    turn = model.soft_bodies[0].rest_position - placed["translation"]
    rotation = turn.T @ np.linalg.pinv(trained.rest_position.T)
    vector = np.array([0.1, -0.2, 0.3])
    for amplitude, expected in (([2.0, -1.0, 0.0], 0.0), ([3.0, 0.0, 0.0], 0.5), ([0.0, 0.0, 1.0], 0.5)):
        local = trained.rest_position + trained.modes @ amplitude
        there = (local @ rotation.T + placed["translation"] - model.base_pivot) @ rotation_from_vector(vector).T
        moved = state.changed(
            position=there + model.base_pivot + [5.0, 6.0, 7.0],
            frame_pose=np.array([[[5.0, 6.0, 7.0], vector]]),
        )
        assert known.beyond(moved)["block"] == pytest.approx(expected, abs=1e-9)
        said = list(watch.complaints(moved, Seen({"block": 0.012})))
        assert len(said) == (expected > 0.0 and amplitude[0] == 3.0)
    assert "above the tolerance of 1 %" in next(watch.complaints_at_start())
    (line,) = watch.complaints(state.changed(time=0.4), Seen({"block": 0.03}))
    assert "'block' is 3.0 times as far from the full equations of motion" in line
    assert "at 0.40 s: its error no longer holds, and is up to some 0.6 mm" in line
    assert not list(watch.complaints(state, Seen({"block": 0.04})))


@pytest.mark.parametrize(
    ("place", "told"), [([9.0, 0.0, 7.0], False), ([-2.0, 0.0, 7.0], True), ([9.0, 7.0, 0.0], True)]
)
def test_a_dent_where_nothing_pressed_is_told(
    body: dict[str, Any], tmp_path: Path, place: list[float], told: bool
) -> None:
    """Trained on presses from above at the far end: as far as a tenth of the length away, and from the side, is new."""
    nodes = make_model(scene_of(body)).soft_bodies[0].mesh.nodes
    pressed = (nodes[:, 0] > 9.9) & (nodes[:, 2] > 4.9)
    modes_of(make_model(scene_of(body)), pressed=pressed).write(tmp_path / "block.npz")
    ball = {"sphere": {"radius": 2.0}, "mass": 1e-3, "position": place}
    ball["velocity"] = [0.0, -30.0 * (place[1] > 5.0), -30.0 * (place[2] > 5.0)]
    reduced = {**body, "reduced": str(tmp_path / "block.npz")}
    simulation = Simulation(scene_of(reduced, gravity=[0.0, 0.0, 0.0], rigid_bodies={"ball": ball}))
    watch, said = TrainingWatch(simulation.model), []
    for _ in range(20):
        simulation.step()
        said += list(watch.complaints(simulation.state.changed(step=20), Seen({})))
    assert len(said) == told and all("'block' is pressed at (" in line for line in said)


@pytest.mark.parametrize(("trained", "told"), [([0.0, 2.0], True), ([-2.0, 2.0], False)])
def test_suction_that_nothing_was_trained_to_is_told(
    block: Callable[..., str], tmp_path: Path, trained: list[float], told: bool
) -> None:
    """-1 kPa in a chamber; far within the amplitudes of the training, which are not known here."""
    mesh = block((4, 4, 4), (20.0, 20.0, 20.0), hollow=True)
    anchors = [{"box": [[-50, -50, -50], [-9.9, 50, 50]]}]
    body = {"mesh": mesh, "density": 1e-6, "young_modulus": 500.0, "poisson_ratio": 0.3, "anchors": anchors}
    body["cavities"] = {"air": {"group": "cavity"}}
    drives = json.dumps({"air": ["pressure", *trained]})
    modes_of(make_model(scene_of(body)), drives=drives).write(tmp_path / "block.npz")
    simulation = Simulation(scene_of({**body, "reduced": str(tmp_path / "block.npz")}))
    watch, said = TrainingWatch(simulation.model), []
    for _ in range(40):
        simulation.step(Control(pressure={"block.air": -1.0}))
        said += list(watch.complaints(simulation.state, Seen({})))
    assert len(said) == told
    assert not told or "pressure of 'block.air' is -1 kPa, trained from 0 to 2" in said[0]


@dataclass(frozen=True)
class Seen:
    """What a watch sees of the report of a step."""

    imbalance: Mapping[str, float]
