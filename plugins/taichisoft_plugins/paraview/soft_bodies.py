"""The soft bodies of a frame as one grid of tetrahedra, with their motion, stress and material."""

from collections.abc import Mapping, Sequence

import numpy as np

from taichisoft.bodies.strain import Stretches
from taichisoft_plugins.paraview.vtu_file import TETRAHEDRON, Grid
from taichisoft_plugins.recording.bodies import RecordedSoftBody
from taichisoft_plugins.recording.reader import Recording
from taichisoft_plugins.stress import recorded_stress, von_mises

ROWS, COLUMNS = [0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]
"""Rows and columns of a symmetric tensor in the order of VTK: xx, yy, zz, xy, yz, xz."""


class SoftBodyGrid:
    """Makes the grid of all soft bodies in any frame."""

    def __init__(self, recording: Recording):
        """Put together what does not change during a run."""
        self._recording = recording
        self._bodies = recording.soft_bodies
        self._stresses = recorded_stress(recording)
        self._stretches = [Stretches(body.rest_position, body.elements) for body in self._bodies]
        self._material = np.concatenate([np.repeat(body.material, body.parts) for body in self._bodies])
        self._rest_position = np.vstack([body.rest_position for body in self._bodies])
        self._cells = np.vstack([body.tetrahedra + body.nodes.start for body in self._bodies])
        # Soft bodies are the first of all bodies, so that their places are their numbers.
        numbers = np.arange(len(self._bodies), dtype=np.int32)
        node_counts = [len(body.rest_position) for body in self._bodies]
        element_counts = [len(body.tetrahedra) for body in self._bodies]
        self._point_data = {
            "body": np.repeat(numbers, node_counts),
            **_members("surface", node_counts, [body.surface_groups for body in self._bodies]),
        }
        self._cell_data = {
            "body": np.repeat(numbers, element_counts),
            **_members("group", element_counts, [_of_parts(body) for body in self._bodies]),
        }

    def __call__(self, frame: int) -> Grid:
        """The grid of a frame."""
        position = self._recording.row("position", frame)
        velocity = self._recording.row("velocity", frame)
        moving = {"displacement": position - self._rest_position, "velocity": velocity}
        stress = np.concatenate(self._stresses(frame))
        present = {
            "stress": stress[:, ROWS, COLUMNS],
            "von_mises": von_mises(stress),
            "largest_stretch": np.concatenate(
                [one.largest(position[body.nodes]) for one, body in zip(self._stretches, self._bodies, strict=True)]
            ),
            "young_modulus": self._recording.row("young_modulus", frame)[self._material],
        }
        return Grid(position, self._cells, TETRAHEDRON, moving | self._point_data, present | self._cell_data)


def _of_parts(body: RecordedSoftBody) -> dict[str, np.ndarray]:
    """The element groups of a body, as groups of its tetrahedra."""
    parts = np.arange(body.parts)
    return {name: (body.parts * group[:, None] + parts).ravel() for name, group in body.element_groups.items()}


def _members(prefix: str, counts: Sequence[int], groups: Sequence[Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Whether each item of all bodies belongs to a group, by "prefix_group"; `groups` has indices within each body."""
    names = dict.fromkeys(name for of_body in groups for name in of_body)
    members = {f"{prefix}_{name}": np.zeros(sum(counts), dtype=bool) for name in names}
    for first, of_body in zip(np.cumsum([0, *counts]), groups, strict=False):
        for name, indices in of_body.items():
            members[f"{prefix}_{name}"][first + np.ravel(indices)] = True
    return members
