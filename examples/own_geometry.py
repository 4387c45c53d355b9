"""Mesh a body of your own kind: a hollow bar, which grows longer under pressure.

A geometry derives from `taichisoft.Geometry`; only `mesh` must be written. A closed surface group whose name begins
with "cavity" is an air chamber, and its triangles point from the air into the silicone. This file is a plug-in, too:
with

    kind = "hollow-bar"
    cells = [6, 3, 3]
    size = 5.0

in bar.toml, `taichisoft mesh bar.toml --plugin examples/own_geometry.py -o out/bar` meshes it, and a scene may say
`mesh = "bar.toml"`. Run as a program, with a folder to keep the mesh, it inflates one: python examples/own_geometry.py

Prints:

    112 nodes, 500.0 mm^3 of air
    20 kPa: 30.455 mm long, 753.2 mm^3 of air
    40 kPa: 31.643 mm long, 1385.0 mm^3 of air
"""

import sys
import tempfile
from collections.abc import Mapping
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np

import taichisoft


class HollowBar(taichisoft.Geometry):
    """A bar along x of `cells` cubes of `size` [mm]; those inside are air. Each cube is cut into six tetrahedra."""

    def __init__(self, tables: Mapping[str, Any], file: Path):
        self.cells, self.size, self.source = np.array(tables["cells"]), float(tables["size"]), str(file)

    def mesh(self, size: float | None = None) -> taichisoft.VolumeMesh:
        scale = size or self.size
        paths = []  # along three edges of a cube, from its first corner to the opposite one, in each order
        for order in permutations(np.eye(3, dtype=int)):
            path = np.vstack([np.zeros(3, dtype=int), np.cumsum(order, axis=0)])
            paths.append(path if np.linalg.det(order) > 0 else path[[0, 2, 1, 3]])
        cubes = np.array(list(np.ndindex(*self.cells)))
        wall = ((cubes == 0) | (cubes == self.cells - 1)).any(axis=1)
        corners = cubes[wall][:, None, None] + np.array(paths)
        nodes, elements = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
        elements = elements.reshape(-1, 4)
        faces = elements[:, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]].reshape(-1, 3)  # facing outwards
        _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
        skin = faces[first[count == 1]]
        inside = ((nodes[skin] > 0) & (nodes[skin] < self.cells)).all(axis=(1, 2))
        groups = {"cavity": skin[inside][:, ::-1], "base": skin[(nodes[skin][..., 0] == 0).all(axis=1)]}
        return taichisoft.VolumeMesh(self.source, scale * nodes, elements, groups)


@taichisoft.hookimpl
def taichisoft_geometry_kinds() -> Mapping[str, Any]:
    """Names the kind for `taichisoft mesh` and for scenes."""
    return {"hollow-bar": HollowBar}


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    mesh = HollowBar({"cells": [6, 3, 3], "size": 5.0}, Path("hollow bar")).mesh()
    taichisoft.write_volume_mesh(mesh, folder / "bar.msh")
    bar = {
        "mesh": str(folder / "bar.msh"),
        "density": 1e-6,
        "young_modulus": 100.0,
        "poisson_ratio": 0.3,
        "rayleigh_stiffness": 0.1,
        "anchors": [{"group": "base"}],
        "cavities": {"air": {"group": "cavity"}},
    }
    scene = taichisoft.scene_from_dict({"gravity": (0.0, 0.0, 0.0), "soft_bodies": {"bar": bar}})
    simulation = taichisoft.Simulation(scene)
    print(f"{simulation.model.node_count} nodes, {simulation.observe().volumes['bar.air']:.1f} mm^3 of air")
    for pressure in (20.0, 40.0):
        for _ in range(60):
            report = simulation.step(taichisoft.Control(pressure={"bar.air": pressure}))
        length = report.observation.tip_positions["bar"][0]
        print(f"{pressure:g} kPa: {length:.3f} mm long, {report.observation.volumes['bar.air']:.1f} mm^3 of air")
