"""Going on from a frame of a recording: scene, meshes and state from the file, so that the bits are the same."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from taichisoft.building.simulation import Simulation
from taichisoft.errors import StateError, TaichisoftError
from taichisoft.meshes.surface import MappedSurface
from taichisoft.model import Model
from taichisoft.scenes.file import scene_from_toml
from taichisoft.scenes.scene import Scene
from taichisoft_plugins.recording.reader import Recording

SAME_PLACE = 1e-6
"""Positions [mm] that differ by less are the same: another machine rounds in another order."""


class ResumeError(TaichisoftError):
    """A run cannot go on from a recording."""


def recorded_scene(recording: Recording, overrides: Sequence[str], controller: str | None) -> Scene:
    """The scene of the recording, with changes as in `taichisoft run`.

    Raises:
        SceneError: something is not valid; begins with the recording's path.
    """
    source = " with --set ".join([str(recording.path), *overrides])
    return scene_from_toml(recording.scene, source, overrides, controller)


def resumed_simulation(recording: Recording, frame: int, scene: Scene) -> Simulation:
    """At the recorded state, with the recorded meshes; surfaces are read from the files that the scene names.

    Raises:
        RecordingError: the frame lacks something.
        ResumeError: a body is not the one that was recorded, or the time step is another.
        TaichisoftError: the model cannot be made.
    """
    state = recording.state(frame)
    bodies = {body.name: body for body in recording.soft_bodies}
    _check_names("soft body", list(bodies), list(scene.soft_bodies), recording.path)
    meshes = {name: bodies[name].mesh(f"{recording.path}: {name}") for name in scene.soft_bodies}
    model = Model(scene, meshes)
    _check_bodies(recording, model)
    simulation = Simulation(model)
    try:
        simulation.restore(state)
    except StateError as error:
        raise ResumeError(f"{recording.path}: {error}") from error
    return simulation


def remaining_time(recording: Recording, frame: int, scene: Scene) -> float:
    """From a frame to the end that the scene gives a run [s].

    Raises:
        ResumeError: there is none.
    """
    time, end = float(recording.row("time", frame)), scene.time.duration
    if end - time < 0.5 * scene.time.step:
        raise ResumeError(
            f"{recording.path}: at {time:g} s the run of {end:g} s is over; say with --duration how much longer it "
            "shall go on, or with --at from where"
        )
    return end - time


def base_has_moved(recording: Recording, frame: int) -> bool:
    """Whether it had since the last start: the goal of a scene is judged from the moment before."""
    base = recording.column("base_translation")
    return bool((base[recording.last_start : frame + 1] != base[recording.last_start]).any())


def _check_bodies(recording: Recording, model: Model) -> None:
    """Refuse what was not recorded: the state would make no sense in it."""
    for recorded, body in zip(recording.soft_bodies, model.soft_bodies, strict=True):
        _check_positions(recording.path, body.name, "rest positions", recorded.rest_position, body.rest_position)
    rigid = {body.name: body for body in recording.rigid_bodies}
    _check_names("rigid body", list(rigid), [body.name for body in model.rigid_bodies], recording.path)
    for name, part in ((body.name, body) for body in model.rigid_bodies):
        _check_positions(recording.path, name, "surface points", rigid[name].vertices, part.vertices)
    surfaces = {surface.name: surface.vertices(0) for surface in recording.surfaces}
    position = recording.row("position", 0)
    for body in model.soft_bodies:
        parts: list[tuple[str, MappedSurface]] = [(body.name, body.surface)]
        parts += [(cavity.name, cavity.surface) for cavity in body.cavities]
        for name, surface in parts:
            now = surface.positions(position[body.nodes])
            _check_positions(recording.path, name, "surface points", surfaces[name], now)
    obstacles = [surface.name for surface in recording.surfaces if surface.kind == "obstacle"]
    obstacles += [plane.name for plane in recording.planes]
    _check_names("obstacle", sorted(obstacles), sorted(part.name for part in model.obstacles), recording.path)


def _check_names(kind: str, recorded: list[str], present: list[str], path: Path) -> None:
    if recorded != present:
        raise ResumeError(
            f"{path}: has {_listed(kind, recorded)}, the scene {_listed(kind, present)}; a run goes on with the bodies "
            "that it had"
        )


def _listed(kind: str, names: list[str]) -> str:
    return f"{kind} {', '.join(names)}" if names else f"no {kind}"


def _check_positions(path: Path, name: str, what: str, recorded: np.ndarray, present: np.ndarray) -> None:
    if recorded.shape != present.shape:
        raise ResumeError(
            f"{path}: '{name}' is not the body that was recorded: its {what} had {len(recorded)} points, now "
            f"{len(present)}"
        )
    moved = float(np.abs(recorded - present).max(initial=0.0))
    if moved > SAME_PLACE:
        raise ResumeError(
            f"{path}: '{name}' is not the body that was recorded: its {what} differ by up to {moved:.3g} mm; undo what "
            "--set or its file changed"
        )
