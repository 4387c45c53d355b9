"""Values at the nodes of soft bodies that colours can show: displacement and stress."""

from collections.abc import Callable

import numpy as np

from taichisoft.bodies.selection import select_nodes
from taichisoft_plugins.recording.reader import RecordedSoftBody, Recording
from taichisoft_plugins.stress import nodal_mean, stress_laws, von_mises

NodeValues = Callable[[RecordedSoftBody, int], np.ndarray]
"""Gives the values of a body's nodes in a frame, shape (node_count,)."""


def displacement(recording: Recording) -> NodeValues:
    """Distance of each node from its place if the body had moved with the base and kept its shape [mm]."""
    pivot = _base_pivot(recording)

    def values(body: RecordedSoftBody, frame: int) -> np.ndarray:
        from scipy.spatial.transform import Rotation

        turn = Rotation.from_rotvec(recording.row("base_rotation", frame)).as_matrix()
        carried = (body.rest_position - pivot) @ turn.T + pivot + recording.row("base_translation", frame)
        return np.linalg.norm(recording.row("position", frame)[body.nodes] - carried, axis=1)

    return values


def stress(recording: Recording) -> NodeValues:
    """Von Mises stress at each node [kPa], the mean of the elements around it."""
    laws = dict(zip(recording.scene.soft_bodies, stress_laws(recording), strict=True))

    def values(body: RecordedSoftBody, frame: int) -> np.ndarray:
        of_elements = von_mises(laws[body.name].stress(recording.row("position", frame)[body.nodes]))
        return nodal_mean(of_elements, body.elements, body.rest_position)

    return values


def _base_pivot(recording: Recording) -> np.ndarray:
    """The point about which the base turns [mm], as the engine finds it."""
    scene = recording.scene
    if scene.base_pivot is not None:
        return np.array(scene.base_pivot)
    anchored = []
    for body in recording.soft_bodies:
        mesh = body.mesh(str(recording.path))
        nodes = [select_nodes(mesh, anchor, "anchors") for anchor in scene.soft_bodies[body.name].anchors]
        anchored += [body.rest_position[np.unique(np.concatenate(nodes))]] if nodes else []
    return np.concatenate(anchored).mean(axis=0) if anchored else np.zeros(3)
