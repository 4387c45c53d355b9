"""Going on from a frame of a recording: scene, meshes and state from the file, so that the bits are the same."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.bodies.cable_paths import cable_paths
from taichisoft.bodies.surfaces import body_surfaces
from taichisoft.building.simulation import Simulation
from taichisoft.errors import StateError, TaichisoftError
from taichisoft.model import Model
from taichisoft.scenes.file import scene_from_toml
from taichisoft.scenes.scene import Scene
from taichisoft.state import State
from taichisoft_plugins.base_motion import last_at_rest
from taichisoft_plugins.recording.reader import Recording

SAME_PLACE = 1e-6
"""Positions [mm] that differ by less are the same: another machine rounds in another order."""


class ResumeError(TaichisoftError):
    """A run cannot go on from a recording."""


def recorded_scene(
    recording: Recording, overrides: Sequence[str], controller: str | None, goal: str | None = None
) -> Scene:
    """The scene of the recording, with changes as in `taichisoft run`.

    Raises:
        SceneError: something is not valid; the message begins with the recording's path.
    """
    source = " with --set ".join([str(recording.path), *overrides])
    return scene_from_toml(recording.scene_text, source, overrides, controller, goal)


def resumed_simulation(recording: Recording, frame: int, scene: Scene) -> Simulation:
    """A simulation in the recorded state, with the recorded meshes; surfaces are read from the files of the scene.

    Raises:
        ResumeError: a body is not the one that was recorded, or the time step is another.
        TaichisoftError: the model cannot be made.
    """
    path, now = recording.path, _names(scene)
    for kind, recorded in _names(recording.scene).items():
        if recorded != now[kind]:
            raise ResumeError(
                f"{path}: has {_listed(kind, recorded)}, the scene {_listed(kind, now[kind])}; a run goes on with what "
                "it had"
            )
    model = Model(scene, {body.name: body.mesh(f"{path}: {body.name}") for body in recording.soft_bodies})
    _check_bodies(recording, model)
    simulation = Simulation(model)
    try:
        simulation.restore(_as_changed(recording.state(frame), recording.scene, model))
    except StateError as error:
        raise ResumeError(f"{path}: {error}") from error
    return simulation


def remaining_time(recording: Recording, frame: int, scene: Scene) -> float:
    """Time from a frame to the end that the scene gives a run [s].

    Raises:
        ResumeError: no time is left.
    """
    time, end = float(recording.row("time", frame)), scene.time.duration
    if end - time < 0.5 * scene.time.step:
        raise ResumeError(
            f"{recording.path}: at {time:g} s the run of {end:g} s is over; say with --duration how much longer it "
            "shall go on, or with --at from where"
        )
    return end - time


def base_has_moved(recording: Recording, frame: int) -> bool:
    """Whether the base has moved since the last start; the goal of a scene is judged from the moment before it does."""
    base = recording.column("base_translation")
    return last_at_rest(base[recording.last_start : frame + 1]) is not None


def _as_changed(state: State, before: Scene, model: Model) -> State:
    """The state with gravity, anchors and Young's moduli as in the model, where its scene is not as it was before."""
    changes = {}
    if model.scene.gravity != before.gravity:
        changes["gravity"] = model.gravity.copy()
    if _anchors(model.scene) != _anchors(before):
        changes["anchor_position"] = model.initial_state().anchor_position
    if model.scene.young_moduli != before.young_moduli:
        changes["young_modulus"] = _young_modulus(state, before.young_moduli, model.scene.young_moduli)
    return state.changed(**changes)


def _young_modulus(state: State, before: dict[str, float], now: dict[str, float]) -> np.ndarray:
    """Young's moduli of the materials [kPa], those of the state for all that the scene has left as they were."""
    of_state = dict(zip(before, state.young_modulus.tolist(), strict=True))
    return np.array([of_state[name] if before.get(name) == modulus else modulus for name, modulus in now.items()])


def _anchors(scene: Scene) -> list[list[dict[str, Any]]]:
    """What is anchored, however stiffly."""
    bodies = scene.soft_bodies.values()
    return [[anchor.model_dump(exclude={"stiffness"}) for anchor in body.anchors] for body in bodies]


def _names(scene: Scene) -> dict[str, list[str]]:
    """Names of what a recorded state belongs to, by kind."""
    return {
        "soft body": list(scene.soft_bodies),
        "cavity": [f"{name}.{cavity}" for name, body in scene.soft_bodies.items() for cavity in body.cavities],
        "cable": [f"{name}.{cable}" for name, body in scene.soft_bodies.items() for cable in body.cables],
        "rigid body": list(scene.rigid_bodies),
        "obstacle": list(scene.obstacles),
    }


def _listed(kind: str, names: list[str]) -> str:
    return f"{kind} {', '.join(names)}" if names else f"no {kind}"


def _check_bodies(recording: Recording, model: Model) -> None:
    """Refuse bodies and cables that are not those recorded: the state would make no sense in them."""
    for recorded, body in zip(recording.soft_bodies, model.soft_bodies, strict=True):
        _check_positions(recording.path, body.name, "rest positions", recorded.rest_position, body.rest_position)
    first, pivot = recording.state(0), recording.base_pivot
    before = {surface.name: surface.vertices(0) for surface in recording.surfaces}
    for surface in body_surfaces(model.soft_bodies, model.rigid_bodies, obstacles=()):
        _check_positions(recording.path, surface.name, "surface points", before[surface.name], surface.vertices(first))
    for cable, path in zip(recording.cable_paths, cable_paths(model.cables), strict=True):
        _check_positions(recording.path, cable.name, "places", cable.place, path.place)
        _check_positions(recording.path, cable.name, "points", cable.points(first, pivot), path.points(first, pivot))


def _check_positions(path: Path, name: str, what: str, recorded: np.ndarray, present: np.ndarray) -> None:
    if recorded.shape != present.shape:
        raise ResumeError(
            f"{path}: '{name}' is not as it was recorded: its {what} were {len(recorded)}, now {len(present)}"
        )
    moved = float(np.abs(recorded - present).max(initial=0.0))
    if moved > SAME_PLACE:
        raise ResumeError(
            f"{path}: '{name}' is not as it was recorded: its {what} differ by up to {moved:.3g} mm; undo what "
            "--set or its file changed"
        )
