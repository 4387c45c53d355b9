"""What the colours of soft bodies can mean: a number at every node of a recording."""

import tomllib
from collections.abc import Callable

import numpy as np

from taichisoft.bodies.selection import select_nodes
from taichisoft.scenes.scene import Scene
from taichisoft_plugins.recording.reader import RecordedSoftBody, Recording
from taichisoft_plugins.stress import StressLaw, nodal_mean, von_mises

NodeValues = Callable[[RecordedSoftBody, int], np.ndarray]
"""Gives the values of a body's nodes in a frame, shape (node_count,)."""


def displacement(recording: Recording) -> NodeValues:
    """Distance of each node from where it would be if the body had moved with the base and kept its shape [mm]."""
    scene = Scene.model_validate(tomllib.loads(recording.scene))
    pivot = _base_pivot(recording, scene)

    def values(body: RecordedSoftBody, frame: int) -> np.ndarray:
        from scipy.spatial.transform import Rotation

        turn = Rotation.from_rotvec(recording.row("base_rotation", frame)).as_matrix()
        carried = (body.rest_position - pivot) @ turn.T + pivot + recording.row("base_translation", frame)
        return np.linalg.norm(recording.row("position", frame)[body.nodes] - carried, axis=1)

    return values


def stress(recording: Recording) -> NodeValues:
    """Von Mises stress at each node [kPa], the mean of the elements around it."""
    scene = Scene.model_validate(tomllib.loads(recording.scene))
    laws = {}
    for body in recording.soft_bodies:
        polar = scene.soft_bodies[body.name].corotation == "polar"
        laws[body.name] = StressLaw(body.rest_position, body.elements, body.young_modulus, body.poisson_ratio, polar)

    def values(body: RecordedSoftBody, frame: int) -> np.ndarray:
        of_elements = von_mises(laws[body.name].stress(recording.row("position", frame)[body.nodes]))
        return nodal_mean(of_elements, body.elements, body.rest_position)

    return values


def _base_pivot(recording: Recording, scene: Scene) -> np.ndarray:
    """The point about which the base turns [mm], as the engine finds it."""
    if scene.base_pivot is not None:
        return np.array(scene.base_pivot)
    anchored = []
    for body in recording.soft_bodies:
        mesh = body.mesh(str(recording.path))
        nodes = [select_nodes(mesh, anchor, "anchors") for anchor in scene.soft_bodies[body.name].anchors]
        anchored += [body.rest_position[np.unique(np.concatenate(nodes))]] if nodes else []
    return np.concatenate(anchored).mean(axis=0) if anchored else np.zeros(3)
