"""The files of a mould: STEP and STL of every part and of the body that comes out of it, and a record of them."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from taichisoft.errors import MeshError
from taichisoft_meshing.finger.pneunet_finger import PneunetFinger
from taichisoft_meshing.geometry_file import make_geometry
from taichisoft_meshing.gmsh_session import gmsh_session
from taichisoft_meshing.mesh_job import MeshJob
from taichisoft_meshing.mesh_record import write_record
from taichisoft_meshing.mould.assembly import triangulate, write_assembly, write_step
from taichisoft_meshing.mould.finger_casts import FingerForm, cast_finger, layer_cast, upper_cast
from taichisoft_meshing.mould.mould_check import RECORD
from taichisoft_meshing.mould.negative import find_plane, negative, outside_of

FORM = {"wall": 6.0, "draft": 1.0, "printable": 1.0, "parting": None}
"""How a mould is made unless something else is asked for: thickness around the silicone [mm], angle by which faces lean
[degrees], least thickness that can be printed [mm], and, of a negative, its parting plane."""
THINNEST, THICKEST, STEEPEST = 5.0, 50.0, 10.0
"""Bounds of the wall [mm], in which pegs have room, and of the draft [degrees]."""


def write_mould(job: MeshJob, folder: Path, form: Mapping[str, Any]) -> None:
    """Write the mould of a finger, or the negative of any other body, and `mould.json`.

    Args:
        job: the body.
        folder: where the files go; it must exist.
        form: values that differ from FORM.

    Raises:
        MeshError: something in the tables or the form is not valid, or OpenCASCADE fails.
        PluginError: the plug-in of the kind failed.
    """
    given, form = form, {**FORM, **form}
    name = job.file.stem
    geometry = make_geometry(job.kind, job.tables, job.file)
    for key, low, high in (("wall", THINNEST, THICKEST), ("draft", 0.0, STEEPEST), ("printable", 0.0, THICKEST)):
        if not low <= form[key] <= high:
            raise MeshError(f"--{key} {form[key]:g}: must be from {low:g} to {high:g}")
    (folder / RECORD).unlink(missing_ok=True)  # never beside files that it does not describe
    if isinstance(geometry, PneunetFinger):
        if form["parting"] is not None:
            raise MeshError(f"--parting {form['parting']}: a finger is parted where its channel ends; leave it out")
        casts = _finger_casts(geometry, job.file, folder, form)
        record = {"kind": "mould", "draft_degrees": form["draft"]}
    else:
        if "draft" in given:
            raise MeshError(f"--draft {form['draft']:g}: a negative has none; leave it out")
        outside, corners, voids = outside_of(geometry, str(job.file))
        plane = find_plane(corners, form["parting"])
        cast = write_assembly(lambda gmsh: negative(gmsh, outside, plane, form["wall"]), folder, f"{name}-negative")
        casts = [{"name": f"{name}-negative", **cast, "voids_mm3": voids}]
        record = {"kind": "negative", "parting": f"{'xyz'[plane[0]]} = {plane[1] + 0.0:g}"}
    sizes = {"wall_mm": form["wall"], "printable_mm": form["printable"]}
    write_record({"name": name, **record, **sizes, "casts": casts}, folder / RECORD)


def _finger_casts(geometry: PneunetFinger, file: Path, folder: Path, settings: Mapping[str, Any]) -> list[Any]:
    """Write the finger as it is cast, and the moulds of its two parts."""
    name = file.stem
    form = FingerForm(geometry.table, settings["wall"], settings["draft"], str(file))
    with gmsh_session(name) as gmsh:
        cast_finger(gmsh.model.occ, form, parted=True)
        write_step(gmsh, folder / f"{name}.step")
    with gmsh_session(name) as gmsh:
        for _, solid in cast_finger(gmsh.model.occ, form, parted=False):  # otherwise the void would be inside out
            gmsh.model.mesh.setOutwardOrientation(solid)
        triangulate(gmsh)
        gmsh.option.setNumber("Mesh.Binary", 1)
        gmsh.write(str(folder / f"{name}.stl"))
    casts = []
    for part, build in (("upper", upper_cast), ("layer", layer_cast)):
        cast = write_assembly(partial(build, form=form), folder, f"{name}-{part}")
        casts.append({"name": f"{name}-{part}", **cast, "voids_mm3": []})
    return casts
