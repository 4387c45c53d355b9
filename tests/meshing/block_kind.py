"""A plug-in with a geometry kind that is meshed at once: boxes around a hollow. Its other keys make it fail."""

import os
import sys
import time
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from blocks import make_block

from taichisoft import Geometry, VolumeMesh, hookimpl
from taichisoft.errors import MeshError


class Block(Geometry):
    """A cube of 50 mm whose walls are one element thick, 10 mm unless a smaller size is given."""

    presets: ClassVar = {"coarse": 10.0, "fine": 5.0}

    def __init__(self, tables: Mapping[str, Any], file: Path):
        unknown = set(tables) - {"stretch", "solid", "after", "end", "remark", "turned"}
        if unknown:
            raise MeshError(f"{file}: {min(unknown)}: unknown key")
        self.tables, self.file = tables, file

    def mesh(self, size: float | None = None) -> VolumeMesh:
        time.sleep(self.tables.get("after", 0.0))
        if "end" in self.tables:
            os._exit(self.tables["end"])
        if "remark" in self.tables:
            warnings.warn(self.tables["remark"], stacklevel=2)
        stretch = self.tables.get("stretch", 1.0)
        if stretch <= 0:
            raise MeshError(f"{self.file}: stretch = {stretch}: must be positive")
        count = round(50.0 / (size or 10.0))
        mesh = make_block((count,) * 3, (50.0, 50.0, 50.0 * stretch), hollow=not self.tables.get("solid", False))
        surfaces = dict(mesh.surface_groups)
        if self.tables.get("turned", False):
            surfaces["cavity"] = surfaces["cavity"][:, ::-1]
        silicone = {"silicone": np.arange(len(mesh.elements))}
        return VolumeMesh("block", mesh.nodes, mesh.elements, surfaces, silicone)


@hookimpl
def taichisoft_geometry_kinds() -> Mapping[str, Any]:
    return {"block": Block}
