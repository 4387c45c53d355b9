"""Going on from an instant of a recording: scene, meshes and state from the file, so that the bits are the same."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft import Scene
from taichisoft.contact import Model
from taichisoft.errors import StateError, TaichisoftError
from taichisoft.mechanics import ACTUATOR_KINDS, State, body_surfaces
from taichisoft.running import Simulation
from taichisoft.scene import scene_from_toml
from taichisoft_outputs.recording.reader import Recording
from taichisoft_outputs.run_figures import last_at_rest

SAME_PLACE = 1e-6
"""Positions [mm] that differ by less are the same: another machine rounds in another order."""
SAME_INSTANT = 1e-3
"""Repeated steps lead at most so far from a recorded instant [mm], which is in single precision."""
REQUESTS = ("frame_request", "frame_velocity", "actuator_request", "network_request")
"""What was asked for in a step, before limits: of no effect on the step itself."""


class ResumeError(TaichisoftError):
    """A run cannot go on from a recording."""


def recorded_scene(
    recording: Recording, overrides: Sequence[str], controller: str | None, goal: str | None = None
) -> Scene:
    """The scene of the recording, with changes as in `taichisoft run`."""
    source = " with --set ".join([str(recording.path), *overrides])
    return scene_from_toml(recording.scene_text, source, overrides, controller, goal)


def resumed_simulation(recording: Recording, instant: int, scene: Scene) -> Simulation:
    """A simulation in the recorded state, with the recorded meshes; surfaces are read from the files of the scene."""
    path, now = recording.path, _names(scene)
    for kind, recorded in _names(recording.scene).items():
        if recorded != now[kind]:
            raise ResumeError(
                f"{path}: has {_listed(kind, recorded)}, the scene {_listed(kind, now[kind])}; a run goes on with what "
                "it had"
            )
    simulation = Simulation(recorded_model(recording, scene))
    _check_bodies(recording, simulation.model)
    as_recorded = simulation if scene == recording.scene else None
    try:
        state = state_at(recording, instant, as_recorded)
        simulation.restore(_as_changed(state, recording.scene, simulation.model))
    except StateError as error:
        raise ResumeError(f"{path}: {error}") from error
    return simulation


def state_at(recording: Recording, instant: int, simulation: Simulation | None = None) -> State:
    """The state in any instant to the bit: from the last recorded one before it, the steps in between are made again.

    Args:
        recording: an open recording.
        instant: index of the instant.
        simulation: of the recorded scene, to make the steps in; one is made where it is needed and not given.
    """
    first = instant
    while not recording.has_state(first):
        first -= 1
    state = recording.state(first)
    if first == instant:
        return state
    simulation = simulation or Simulation(recorded_model(recording, recording.scene))
    simulation.restore(state)
    for control in (control for number in range(first + 1, instant + 1) for control in recording.controls(number)):
        _repeat_step(simulation, control)
    state = simulation.state.changed(**{name: recording.field(name, instant) for name in REQUESTS})
    off = float(np.abs(state.position - recording.row("position", instant)).max(initial=0.0))
    if state.step != recording.row("step", instant) or off > SAME_INSTANT:
        raise ResumeError(
            f"{recording.path}: the steps from {recording.row('time', first):g} s on do not lead to "
            f"{recording.row('time', instant):g} s as it was recorded, by another version or with lost instants; "
            f"go on from {recording.row('time', first):g} s"
        )
    return state


def _repeat_step(simulation: Simulation, control: dict[str, np.ndarray]) -> None:
    """Make a step with what a controller acted through: asked for as it became, no limit changes it."""
    asked = {
        "frame_request": control["frame_pose"],
        "frame_velocity": np.zeros_like(control["frame_pose"]),
        "actuator_request": control["actuator_target"],
        "external_force_steps": control["external_force_steps"] + (control["external_force_steps"] > 0),
        "network_request": control["network_target"],
    }
    simulation.restore(simulation.state.changed(**{**control, **asked}))
    simulation.step()


def recorded_model(recording: Recording, scene: Scene) -> Model:
    """The model of a scene with the meshes of a recording."""
    return Model(scene, {body.name: body.mesh(f"{recording.path}: {body.name}") for body in recording.soft_bodies})


def remaining_time(recording: Recording, instant: int, scene: Scene) -> float:
    """Time from an instant to the end that the scene gives a run [s]."""
    time, end = float(recording.row("time", instant)), scene.time.duration
    if end - time < 0.5 * scene.time.step:
        raise ResumeError(
            f"{recording.path}: at {time:g} s the run of {end:g} s is over; say with --duration how much longer it "
            "shall go on, or with --at from where"
        )
    return end - time


def saved_controller(recording: Recording, instant: int, scene: Scene) -> tuple[dict[str, Any] | None, str]:
    """What the scene's controller remembers in an instant, and a remark where it has to begin again."""
    before, now = recording.scene.controller, scene.controller
    if before is None or now is None or before.name != now.name:
        return None, ""
    saved = recording.controller_state(instant)
    if saved is None:
        return None, f"; the controller '{now.name}' begins again, since it does not save what it remembers"
    return saved, ""


def base_has_moved(recording: Recording, instant: int) -> bool:
    """Whether the base has moved since the last start; the goal of a scene is judged from the moment before it does."""
    base = recording.base_translation
    return last_at_rest(base[recording.last_start : instant + 1]) is not None


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
    """Young's moduli of the materials [kPa]: the state's values wherever the scene has left them unchanged."""
    of_state = dict(zip(before, state.young_modulus.tolist(), strict=True))
    return np.array([of_state[name] if before.get(name) == modulus else modulus for name, modulus in now.items()])


def _anchors(scene: Scene) -> list[list[dict[str, Any]]]:
    bodies = scene.soft_bodies.values()
    return [[anchor.model_dump(exclude={"stiffness"}) for anchor in body.anchors] for body in bodies]


def _names(scene: Scene) -> dict[str, list[str]]:
    return {
        "soft body": list(scene.soft_bodies),
        **{kind.name: list(scene.actuators(kind.plural)) for kind in ACTUATOR_KINDS},
        "rigid body": list(scene.rigid_bodies),
        "obstacle": list(scene.obstacles),
        "frame": list(scene.frames),
        "part of the air network": [*scene.air.nodes, *scene.air.parts],
    }


def _listed(kind: str, names: list[str]) -> str:
    return f"{kind} {', '.join(names)}" if names else f"no {kind}"


def _check_bodies(recording: Recording, model: Model) -> None:
    """Refuse bodies and actuators that are not those recorded: the state would make no sense in them."""
    for recorded, body in zip(recording.soft_bodies, model.soft_bodies, strict=True):
        _check_positions(recording.path, body.name, "rest positions", recorded.rest_position, body.rest_position)
    first = recording.state(0)
    recorded_at = {surface.name: surface.vertices(0) for surface in recording.surfaces}
    for surface in body_surfaces(model.soft_bodies, model.rigid_bodies, obstacles=()):
        _check_positions(
            recording.path, surface.name, "surface points", recorded_at[surface.name], surface.vertices(first)
        )
    for kind in ACTUATOR_KINDS:
        for line, now in zip(recording.lines(kind), model.actuators.sets[kind.name].lines, strict=True):
            _check_positions(recording.path, line.name, "places", line.place, now.place)
            points = [one.points(first, frames) for one, frames in ((line, recording.frames), (now, model.frames))]
            _check_positions(recording.path, line.name, "points", *points)
    for name, before, now_at in zip(recording.frames.names, recording.frames.pivot, model.frames.pivot, strict=True):
        _check_positions(recording.path, name, "pivots", before[None], now_at[None])


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
