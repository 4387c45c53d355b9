"""What the colours of soft bodies can mean: a number at every node of a recording."""

import tomllib
from collections.abc import Callable

import numpy as np

from taichisoft.scene import Scene
from taichisoft.selection import select_nodes
from taichisoft_plugins.recording_reader import RecordedSoftBody, Recording
from taichisoft_plugins.stress import element_stress, nodal_mean, von_mises

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

    def values(body: RecordedSoftBody, frame: int) -> np.ndarray:
        position = recording.row("position", frame)[body.nodes]
        polar = scene.soft_bodies[body.name].corotation == "polar"
        material = body.young_modulus, body.poisson_ratio
        tensors = element_stress(body.rest_position, body.elements, *material, position, polar)
        return nodal_mean(von_mises(tensors), body.elements, body.rest_position)

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
