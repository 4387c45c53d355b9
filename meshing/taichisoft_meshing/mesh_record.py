"""`mesh.json`: the inputs of a mesh, and its figures."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import taichisoft
from taichisoft.base import atomic_file
from taichisoft.errors import MeshError
from taichisoft.mesh import VolumeMesh
from taichisoft_meshing.cad_body import CadBody
from taichisoft_meshing.gmsh_session import gmsh_version
from taichisoft_meshing.mesh_job import MadeMesh, MeshJob
from taichisoft_meshing.mesh_quality import MeshQuality
from taichisoft_meshing.wall_quality import SurfaceQuality


def mesh_record(made: MadeMesh, files: Iterable[Path]) -> dict[str, Any]:
    """Everything about a mesh except the time that it took: equal meshes have equal records.

    Args:
        made: the mesh.
        files: files of the mesh, of which the record has hashes.
    """
    job, parameters = made.job, made.geometry.parameters
    return {
        "kind": job.kind,
        "file": job.file.name,
        "parameters": job.tables if parameters is None else parameters,
        "asked": job.asked,
        "inputs_sha256": _hash_of_inputs(job),
        "versions": {"taichisoft": taichisoft.__version__, "gmsh": gmsh_version()},
        **mesh_figures(made.mesh, made.quality),
        "limits": made.limits.model_dump(),
        "problems": made.problems,
        "remarks": made.remarks,
        "files_sha256": {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files},
    }


def mesh_figures(mesh: VolumeMesh, quality: MeshQuality) -> dict[str, Any]:
    """Counts, volumes, groups and quality of a mesh as plain values."""
    return {
        "counts": {"nodes": len(mesh.nodes), "tetrahedra": len(mesh.elements)},
        "volumes_mm3": {
            "silicone": _rounded(quality.volumes.sum(), 12),
            **{surface.name: _rounded(surface.volume, 12) for surface in quality.surfaces if surface.closed_by_name},
        },
        "groups": {
            "surfaces": {name: {"triangles": len(group)} for name, group in mesh.surface_groups.items()},
            "elements": {name: {"tetrahedra": len(group)} for name, group in mesh.element_groups.items()},
        },
        "quality": {
            "radius_ratio": _spread(quality.radius_ratios),
            "dihedral_angle_degrees": _spread(quality.dihedral_angles),
            "element_volume_mm3": _spread(quality.volumes),
            "shortest_edge_mm": _rounded(quality.edges.min()),
            "longest_edge_mm": _rounded(quality.edges.max()),
            "elements_across_walls": quality.elements_across_walls,
            "walls": [
                {
                    "between": list(wall.sides),
                    "thinnest_mm": _rounded(wall.thinnest),
                    "elements_across": wall.elements_across,
                    "share_one_element_thick": _rounded(wall.share_of_one),
                }
                for wall in quality.walls
            ],
            "surfaces": {surface.name: surface_figures(surface) for surface in quality.surfaces},
            "inverted_elements": quality.inverted,
            "duplicate_nodes": quality.duplicate_nodes,
            "pieces": quality.components,
        },
    }


def body_figures(body: CadBody) -> dict[str, Any]:
    """Solids, faces, cavities and openings of a body from CAD as plain values."""
    return {
        "extent_mm": [_rounded(length) for length in body.extent],
        "solids": [
            {"number": one.number, "name": one.name, "volume_mm3": _rounded(one.volume, 12)} for one in body.solids
        ],
        "faces": [
            {
                "number": face.number,
                "solids": list(face.solids),
                "area_mm2": _rounded(face.area),
                "centre_mm": face.centre.round(6).tolist(),
                "normal": None if face.normal is None else face.normal.round(6).tolist(),
            }
            for face in body.faces
        ],
        "flat_end": list(body.flat_end),
        "cavities_mm3": [_rounded(volume, 12) for volume in body.void_volumes],
        "openings": [
            {
                "face": one.beside,
                "centre_mm": one.centre.round(6).tolist(),
                "area_mm2": _rounded(one.area),
                "volume_mm3": _rounded(one.volume),
            }
            for one in body.openings
        ],
    }


def surface_figures(surface: SurfaceQuality) -> dict[str, Any]:
    """Figures of a surface as plain values."""
    return {
        "triangles": len(surface.triangles),
        "area_mm2": _rounded(surface.area),
        "closed": surface.open_edges == 0,
    }


def write_record(record: Mapping[str, Any], path: Path) -> None:
    """Write a record as JSON."""
    with atomic_file(path, MeshError) as partial:
        partial.write_text(json.dumps(record, indent=2, allow_nan=False, default=list) + "\n", encoding="utf-8")


def _hash_of_inputs(job: MeshJob) -> str | None:
    """The hash that the cache of scenes' meshes uses; None for a plug-in without source."""
    try:
        return job.fingerprint()
    except OSError:
        return None


def _spread(values: np.ndarray) -> dict[str, float]:
    return {
        "smallest": _rounded(values.min()),
        "median": _rounded(np.median(values)),
        "largest": _rounded(values.max()),
    }


def _rounded(value: float, digits: int = 6) -> float:
    """Round to significant digits: the last ones depend on the machine's arithmetic."""
    return float(f"{value:.{digits}g}")
