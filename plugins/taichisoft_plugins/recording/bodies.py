"""What of a recording does not change during a run: the header and the bodies."""

import json
import platform
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

import numpy as np

import taichisoft
from taichisoft.scenes.file import scene_to_toml
from taichisoft_plugins.recording.layout import LAYOUT

if TYPE_CHECKING:
    from taichisoft.bodies.soft_body import SoftBody
    from taichisoft.meshes.surface import MappedSurface
    from taichisoft.model import Model


PACKAGES = ("taichi", "numpy", "scipy", "h5py")


def write_header(file: Any, model: "Model", every: int, fields: tuple[str, ...]) -> None:
    """Write the file's attributes; until the run has ended its outcome is "unfinished"."""
    import h5py

    attributes = file.attrs
    attributes["taichisoft_version"] = taichisoft.__version__
    attributes["versions"] = json.dumps(_versions())
    attributes["layout"] = LAYOUT
    attributes["scene"] = scene_to_toml(model.scene)
    attributes["every"] = every
    attributes.create("fields", list(fields), (len(fields),), h5py.string_dtype())
    attributes["gravity"] = np.array(model.scene.gravity, dtype=np.float64)
    attributes["step_size"] = float(model.scene.time.step)
    attributes["outcome"] = "unfinished"


def _versions() -> dict[str, str]:
    """Of what computes the run, and the machine that it does so on."""
    versions = {"taichisoft": taichisoft.__version__, "Python": platform.python_version()}
    for package in PACKAGES:
        with suppress(PackageNotFoundError):
            versions[package] = version(package)
    return {**versions, "machine": f"{platform.system()} {platform.machine()}"}


def write_bodies(file: Any, model: "Model") -> None:
    """Write meshes, materials and surfaces."""
    for index, body in enumerate(model.soft_bodies):
        _write_soft_body(file.create_group(f"soft_bodies/{index}"), body)
    for index, rigid in enumerate(model.rigid_bodies):
        group = file.create_group(f"rigid_bodies/{index}")
        group.attrs["name"] = rigid.name
        group["vertices"], group["triangles"] = rigid.vertices, rigid.triangles
    for index, obstacle in enumerate(model.obstacles):
        group = file.create_group(f"obstacles/{index}")
        group.attrs["name"] = obstacle.name
        if obstacle.vertices is None:
            group.attrs["point"], group.attrs["normal"] = obstacle.point, obstacle.normal
        else:
            group["vertices"], group["triangles"] = obstacle.vertices, obstacle.triangles


def write_columns(file: Any, cavities: list[str], pairs: list[str]) -> None:
    """Write what the columns of quantities by cavity and by pair of bodies are called."""
    import h5py

    attributes = file.require_group("steps").attrs
    attributes.create("cavities", cavities, (len(cavities),), h5py.string_dtype())
    attributes.create("pairs", pairs, (len(pairs),), h5py.string_dtype())


def _write_soft_body(group: Any, body: "SoftBody") -> None:
    group.attrs["name"] = body.name
    group.attrs["nodes"] = (body.nodes.start, body.nodes.stop)
    group["mesh_nodes"] = body.mesh.nodes
    group["rest_position"] = body.rest_position
    group["elements"] = body.elements
    group["young_modulus"], group["poisson_ratio"] = _engineering_constants(body.lame)
    for kind in ("element_groups", "surface_groups"):
        groups = group.create_group(kind)
        for name, members in getattr(body.mesh, kind).items():
            groups[name] = members
    _write_surface(group.create_group("surface"), body.surface)
    for number, cavity in enumerate(body.cavities):
        cavity_group = group.create_group(f"cavities/{number}")
        cavity_group.attrs["name"] = cavity.name
        _write_surface(cavity_group, cavity.surface)


def _engineering_constants(lame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Young's modulus [kPa] and Poisson's ratio from Lame's lambda and mu."""
    first, second = lame.T
    return second * (3.0 * first + 2.0 * second) / (first + second), 0.5 * first / (first + second)


def _write_surface(group: Any, surface: "MappedSurface") -> None:
    group["nodes"], group["weights"], group["triangles"] = surface.nodes, surface.weights, surface.triangles
