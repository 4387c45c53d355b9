"""The mould of a finger, made as PneuNets are: the part with open chambers and the layer that closes them, each cast.

The finger lies with its slots down, and what is cast comes out upward, along y. The two castings meet where the channel
ends, in the plane y = channel.top. A box has the outside of the upper part, and a lid closes it, from which the cores
of the chambers hang. A tray has the outside of the layer; its lid leaves room for the stiffer silicone, or for paper.
See D. Holland et al. 2014, The Soft Robotics Toolkit, Soft Robotics 1(3), for the way to cast and to join them.
"""

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.base import SIZE, implausible, warn_caller
from taichisoft.errors import MeshError
from taichisoft.running import Geometry
from taichisoft_meshing.body_mould import (
    CLEARANCE,
    POUR,
    THICKEST_PEG,
    VENT,
    parse_parting,
    plan_castings,
    write_casting,
)
from taichisoft_meshing.cad_body import import_solids
from taichisoft_meshing.closed_shells import Shell, closed_shells
from taichisoft_meshing.file_bodies import StepBody, SurfacesBody
from taichisoft_meshing.finger_dimensions import THINNEST_WALL, FingerParameters, end
from taichisoft_meshing.geometry_file import make_geometry
from taichisoft_meshing.gmsh_session import gmsh_session
from taichisoft_meshing.mesh_job import MeshJob, call_with_plugins
from taichisoft_meshing.mesh_set import write_record
from taichisoft_meshing.mould_assembly import Assembly, triangles_of, triangulate, write_assembly, write_step
from taichisoft_meshing.mould_check import RECORD
from taichisoft_meshing.pneunet_finger import (
    Box,
    Draft,
    PneunetFinger,
    Solids,
    finger_cavity,
    finger_outside,
    inlet_bore,
    solid_box,
    stiff_layer_box,
)

LEAST_SOFT = 0.05
"""Least share of the layer around the stiff one for a lid to make sense [-]."""
UP, OUTWARD = (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)


@dataclass(frozen=True)
class FingerForm:
    """How the mould of a finger is made.

    Attributes:
        finger: its dimensions.
        wall: thickness of the mould around it [mm].
        draft: angle by which faces lean [degrees].
        source: begins every error.

    Raises:
        MeshError: a finger of these dimensions cannot be cast so.
    """

    finger: FingerParameters
    wall: float
    draft: float
    source: str

    def __post_init__(self) -> None:
        layer, top = self.finger.stiff_layer, self.finger.channel.top
        if layer.thickness and layer.bottom < top - 1e-9:
            raise MeshError(
                f"{self.source}: stiff_layer.bottom = {layer.bottom:g}: must be at least {top:g} (channel.top) "
                "for a mould: the stiff layer is cast in the part that closes the chambers"
            )
        for what, room, growth in self._rooms():
            steepest = math.degrees(math.atan(max(room, 0.0) / growth))
            if self.draft > steepest:
                most = math.floor(100 * steepest) / 100
                raise MeshError(f"{self.source}: --draft {self.draft:g}: {what}; must be at most {most:g}")

    @property
    def leaning(self) -> Draft:
        """The draft of outside, slots and cores: everything has its drawn size at half the height of the chambers."""
        return Draft(math.tan(math.radians(self.draft)), self.finger.channel.top / 2)

    def _rooms(self) -> list[tuple[str, float, float]]:
        """What would vanish with a steep draft: in words, how wide it is [mm], and what it loses for a slope of 1."""
        finger, middle = self.finger, self.finger.channel.top / 2
        slots, chambers, channel = finger.slots, finger.chambers, finger.channel
        bottom = channel.bottom - chambers.height
        narrow = min(chambers.width - 2 * chambers.fillet_radius, chambers.depth)
        rooms = [
            ("the chambers would close", narrow, 2 * (middle - bottom)),
            ("the channel would leave no wall at the base", channel.start, channel.top - middle),
        ]
        if chambers.count > 1:
            gap = chambers.pitch - chambers.width
            rooms.append(("the chambers would meet", gap, 2 * (channel.bottom - middle)))
        if slots.count:
            rooms.append(("the slots would close", slots.width - 2 * slots.fillet_radius, 2 * (slots.depth - middle)))
            rooms.append(("the first slot would reach the base", slots.first, middle))
            rooms.append(("the last slot would reach the tip", finger.body.length - end(slots), middle))
        if slots.count > 1:
            rooms.append(("the slots would meet", slots.pitch - slots.width, 2 * middle))
        return [(what, room - THINNEST_WALL, growth) for what, room, growth in rooms if growth > 0.0]


def cast_finger(occ: Any, form: FingerForm, parted: bool) -> Solids:
    """The finger as it comes out of the mould, with its cavity as a void; if `parted`, its stiff layer is a solid of
    its own, the first one."""
    finger, draft = form.finger, form.leaning
    solid, _ = occ.cut(finger_outside(occ, finger, draft), finger_cavity(occ, finger, draft))
    if parted and finger.stiff_layer.thickness:
        room = occ.intersect(_room(occ, form), solid, removeTool=False)[0]
        occ.fragment(solid, occ.cut(room, [_above_stiff_layer(occ, form)])[0])
    occ.synchronize()
    return list(occ.getEntities(3))


def upper_cast(gmsh: Any, form: FingerForm) -> Assembly:
    """Box and lid of the part with the open chambers, and the slide that leaves the bore of the inlet."""
    occ, finger, top, wall = gmsh.model.occ, form.finger, form.finger.channel.top, form.wall
    whole = _between(occ, form, 0.0, top)
    core = finger_cavity(occ, finger, form.leaning, inlet=False)
    silicone, _ = occ.cut(whole, core, removeObject=False, removeTool=False)
    lower, upper = _bounds(occ, whole)
    box, plate, block, gaps = _box_and_plate(occ, form, lower, upper, top, through=True)
    box, _ = occ.cut(box, whole)
    lid, _ = occ.fuse(plate, core, removeTool=False)
    holes = _holes(occ, form, top, finger.channel.start, -lower[0] - finger.channel.end, lower[0], upper[2])
    parts: dict[str, Solids] = {}
    ways = {"lid": UP, "cast": UP}
    if finger.inlet.diameter:
        reach = min(finger.inlet.diameter / 2 + 2.0, finger.body.width / 2)
        foot = (finger.channel.bottom + finger.channel.top - finger.inlet.diameter) / 2 - 2.0
        beyond, narrow = upper[0] + wall, reach - CLEARANCE
        notch = occ.addBox(0.0, foot, -reach, beyond, top - foot, 2 * reach)
        box, _ = occ.cut(box, [(3, notch)])
        bore, _ = occ.cut([inlet_bore(occ, finger, 0.0, deeper=1.0)], core, removeTool=False)
        silicone, _ = occ.cut(silicone, bore, removeTool=False)
        block_of_slide = occ.addBox(0.0, foot, -narrow, beyond, top - foot, 2 * narrow)
        parts["slide"], _ = occ.fuse([(3, block_of_slide)], bore)
        ways["slide"] = OUTWARD
        gaps += 2 * CLEARANCE * beyond * (top - foot)
    occ.remove(core, True)
    lid, silicone = _bored(occ, lid, silicone, holes)
    parts |= {"lid": lid, "cast": silicone, "box": box}
    return Assembly(parts, ways, "cast", block, gaps, (("the upper part", "soft", _volume(occ, silicone)),))


def layer_cast(gmsh: Any, form: FingerForm) -> Assembly:
    """Tray of the layer that closes the chambers, and the lid that leaves room for the stiffer silicone in it."""
    occ, finger, top, height = gmsh.model.occ, form.finger, form.finger.channel.top, form.finger.body.height
    layer = finger.stiff_layer
    silicone = _between(occ, form, top, height)
    lower, upper = _bounds(occ, silicone)
    tray, plate, block, gaps = _box_and_plate(occ, form, lower, upper, height, through=layer.thickness > 0.0)
    tray, _ = occ.cut(tray, silicone, removeTool=False)
    ways = {"lid": UP, "cast": UP}
    if not layer.thickness:
        pour = ("the layer", "soft", _volume(occ, silicone))
        return Assembly({"cast": silicone, "tray": tray}, ways, "cast", block, gaps, (pour,))
    room, _ = occ.intersect(_room(occ, form), silicone, removeTool=False)
    of_room, whole = _volume(occ, room), _volume(occ, silicone)
    if whole - of_room < LEAST_SOFT * whole:
        raise MeshError(
            f"{form.source}: stiff_layer: fills the whole part that closes the chambers; give it "
            "stiff_layer.thickness = 0 here, and cast the layer of stiff silicone"
        )
    silicone, _ = occ.cut(silicone, room, removeTool=False)
    cover, _ = occ.intersect(room, [_above_stiff_layer(occ, form)], removeObject=False)
    of_cover = _volume(occ, cover)
    occ.remove(cover, True)
    lid, _ = occ.fuse(plate, room)
    holes = _holes(occ, form, height, layer.start, -lower[0] - layer.end, lower[0], upper[2])
    lid, silicone = _bored(occ, lid, silicone, holes)
    pours = (
        ("the layer around the room for the stiff one", "soft", _volume(occ, silicone)),
        ("the stiff layer, into that room", "stiff", of_room - of_cover),
        *([("the cover of the stiff layer", "soft", of_cover)] if of_cover > 1e-6 else []),
    )
    return Assembly({"lid": lid, "cast": silicone, "tray": tray}, ways, "cast", block, gaps, pours)


def _room(occ: Any, form: FingerForm) -> Solids:
    """The room for the stiff layer and its cover: from the layer's underside to the back."""
    stiff, height = stiff_layer_box(form.finger), form.finger.body.height
    assert stiff is not None
    x, y, z = stiff.corner
    recess = Box((x, y, z), (stiff.size[0], height - y, stiff.size[2]))
    return [solid_box(occ, recess, Draft(form.leaning.slope, (y + height) / 2))]


def _above_stiff_layer(occ: Any, form: FingerForm) -> tuple[int, int]:
    """All that lies above the stiff layer."""
    body, layer = form.finger.body, form.finger.stiff_layer
    bottom = layer.bottom + layer.thickness
    return 3, occ.addBox(-2 * body.length, bottom, -2 * body.width, 3 * body.length, body.height, 4 * body.width)


def _between(occ: Any, form: FingerForm, bottom: float, top: float) -> Solids:
    """The part of the outside between two heights [mm]."""
    body = form.finger.body
    slab = occ.addBox(-2 * body.length, bottom, -2 * body.width, 3 * body.length, top - bottom, 4 * body.width)
    part: Solids = occ.intersect(finger_outside(occ, form.finger, form.leaning), [(3, slab)])[0]
    return part


def _box_and_plate(
    occ: Any, form: FingerForm, lower: list[float], upper: list[float], top: float, through: bool
) -> tuple[Solids, Solids, float, float]:
    """The block around a casting up to the height `top`, and, if `through`, the plate over it, joined by four pegs.

    Returns:
        The two solids, the volume of the box around both, and that of the gaps around the pegs [mm^3].
    """
    wall, bottom = form.wall, lower[1] - form.wall
    x, z = lower[0] - wall, lower[2] - wall
    length, width = upper[0] - lower[0] + 2 * wall, upper[2] - lower[2] + 2 * wall
    block: Solids = [(3, occ.addBox(x, bottom, z, length, top - bottom, width))]
    if not through:
        return block, [], length * width * (top - bottom), 0.0
    plate: Solids = [(3, occ.addBox(x, top, z, length, wall, width))]
    radius, tall = min(wall / 4, THICKEST_PEG), min(wall - 1.0, 4 * THICKEST_PEG)
    places = [(x + a, z + b) for a in (wall / 2, length - wall / 2) for b in (wall / 2, width - wall / 2)]
    pegs = [(3, occ.addCylinder(a, top, b, 0, tall, 0, radius)) for a, b in places]
    holes = [(3, occ.addCylinder(a, top, b, 0, wall, 0, radius + CLEARANCE)) for a, b in places]
    block, _ = occ.fuse(block, pegs)
    plate, _ = occ.cut(plate, holes)
    gaps = 4 * math.pi * ((radius + CLEARANCE) ** 2 * wall - radius**2 * tall)
    return block, plate, length * width * (top - bottom + wall), gaps


def _holes(occ: Any, form: FingerForm, y: float, base: float, tip: float, end_x: float, half: float) -> Solids:
    """Holes through a lid: to pour at the base, and for air at the tip and the corners of the base.

    Args:
        occ: `gmsh.model.occ`.
        form: the mould.
        y: height of the lid's lower side [mm].
        base: how far the silicone under the lid reaches from the base without a break [mm].
        tip: how far it reaches from the tip [mm].
        end_x: position x of the tip there [mm].
        half: half of the width there [mm].
    """
    places = []
    pour = min(POUR, 0.35 * base, 0.7 * half)
    if pour >= 1.5 * VENT:
        places.append((-base / 2, 0.0, pour))
    corner = 2.5 * VENT
    if base > 2 * corner and half - corner > pour + 2 * VENT:
        places += [(-corner, side * (half - corner), VENT) for side in (-1.0, 1.0)]
    if tip > 4 * VENT:
        places.append((end_x + tip / 2, 0.0, VENT))
    holes = []
    for x, z, half_side in places:  # square ones, whose flat faces have no corners that hold
        box = Box((x - half_side, y, z - half_side), (2 * half_side, form.wall, 2 * half_side))
        holes.append(solid_box(occ, box, Draft(min(form.leaning.slope, half_side / 2 / form.wall), y), -1.0))
    return holes


def _bored(occ: Any, lid: Solids, silicone: Solids, holes: Solids) -> tuple[Solids, Solids]:
    """A lid with holes, and the silicone with what fills them."""
    if not holes:
        return lid, silicone
    return occ.cut(lid, holes, removeTool=False)[0], occ.fuse(silicone, holes)[0]


def _bounds(occ: Any, solids: Solids) -> tuple[list[float], list[float]]:
    """Smallest and largest coordinates of solids [mm], which OpenCASCADE gives with some room of 1e-7."""
    boxes = [[round(value, 6) for value in occ.getBoundingBox(*solid)] for solid in solids]
    return [min(box[axis] for box in boxes) for axis in range(3)], [
        max(box[axis + 3] for box in boxes) for axis in range(3)
    ]


def _volume(occ: Any, solids: Solids) -> float:
    return float(sum(occ.getMass(*solid) for solid in solids))


# The files of a mould: every part, of a finger the finger too, and a record of them.

FORM = {"wall": 6.0, "draft": 1.0, "printable": 1.0, "skin": 0.5, "chord": 0.02, "parting": None, "whole": False}
"""How a mould is made unless something else is asked for: thickness around the silicone [mm], angle by which faces lean
[degrees], least thicknesses that can be printed and filled [mm], error of facets [mm], and, of a body that is no
finger, direction in which its outer parts come off and perhaps position of the parting plane, and whether it must be
cast in one."""
THICK = 0.0, 50.0
BOUNDS = {"wall": (5.0, 50.0), "draft": (0.0, 10.0), "printable": THICK, "skin": THICK, "chord": (1e-3, 1.0)}
"""Of the wall, in which pegs have room, and the others."""


def write_mould(job: MeshJob, folder: Path, form: Mapping[str, Any]) -> None:
    """Write the mould of a body and `mould.json`.

    Args:
        job: the body.
        folder: where the files go; it must exist.
        form: values that differ from FORM.
    """
    form = {**FORM, **form}
    geometry = make_geometry(job.kind, job.tables, job.file)
    for key, (low, high) in BOUNDS.items():
        if not low <= form[key] <= high:
            raise MeshError(f"--{key} {form[key]:g}: must be from {low:g} to {high:g}")
    (folder / RECORD).unlink(missing_ok=True)  # never beside files that it does not describe
    if isinstance(geometry, PneunetFinger):
        if form["parting"] is not None or form["whole"]:
            option = "--whole" if form["whole"] else f"--parting {form['parting']}"
            raise MeshError(f"{option}: a finger is parted where its channel ends; leave it out")
        casts = _finger_casts(geometry, job.file, folder, form)
    else:
        shells = _shells_of(geometry, job.file, form["chord"])
        casts = _castings(job.file, folder, shells, form)
    record = {f"{key}_mm": form[key] for key in ("wall", "printable", "skin", "chord")}
    record |= {"name": job.file.stem, "draft_degrees": form["draft"], "casts": casts}
    write_record(record, folder / RECORD)


def write_mould_apart(job: MeshJob, folder: Path, form: Mapping[str, Any]) -> None:
    """Write a mould as `write_mould` does, in a process of its own."""
    call_with_plugins(write_mould, job, folder, form)


def _castings(file: Path, folder: Path, shells: Sequence[Shell], form: Mapping[str, Any]) -> list[Any]:
    """Write the castings of a body in the best way in which all lost cores are held."""
    if doubt := implausible(f"{file}: its longest side", float(np.ptp(shells[0].vertices, axis=0).max()), SIZE):
        raise MeshError(f"{doubt}; `--set scale=1000` takes surfaces in metres")
    errors = []
    for castings in plan_castings(shells, parse_parting(form["parting"], shells[0].vertices), form["whole"]):
        try:
            return [write_casting(casting, folder, file.stem, form["wall"], form["draft"]) for casting in castings]
        except MeshError as error:
            errors.append(error)
    raise MeshError(f"{file}: {errors[0]}")


def _shells_of(geometry: Geometry, file: Path, chord: float) -> list[Shell]:
    """The outside of a body, then its closed chambers.

    The faces of a STEP body get facets that miss them by `chord` [mm] at most; surfaces are taken as they are, and any
    other body as it is meshed.
    """
    if isinstance(geometry, SurfacesBody):
        return [geometry.body.outer, *geometry.body.cavities]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # chambers may be open here, and gmsh turns triangles as it likes
        if not isinstance(geometry, StepBody):
            mesh = geometry.mesh(None)
            walls = [triangles for name, triangles in mesh.surface_groups.items() if name.startswith("cavity")]
            groups = [mesh.surface_groups["outer"], *walls]
            return [shell for its in groups for shell in closed_shells(mesh.nodes, its, str(file))]
        body = geometry.body
        with gmsh_session(file.name) as gmsh:
            import_solids(gmsh, body.path, body.defeature)
            triangulate(gmsh, chord)
            shells = closed_shells(*triangles_of(gmsh, sorted(body.outside.union(*body.voids))), str(file))
    if len(body.solids) > 1:
        warn_caller(f"{file}: its {len(body.solids)} solids are cast as one, of one silicone")
    return sorted(shells, key=lambda shell: -shell.volume)


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
        triangulate(gmsh, settings["chord"])
        gmsh.option.setNumber("Mesh.Binary", 1)
        gmsh.write(str(folder / f"{name}.stl"))
    casts = []
    for part, build in (("upper", upper_cast), ("layer", layer_cast)):
        cast = write_assembly(partial(build, form=form), folder, f"{name}-{part}", settings["chord"])
        casts.append({"name": f"{name}-{part}", **cast})
    return casts
