"""STEP files: their text checked, and their solids in gmsh, which share the faces where they touch."""

import re
from pathlib import Path
from typing import Any

from taichisoft.errors import MeshError
from taichisoft.meshes import require_suffix
from taichisoft_meshing.geometry_file import STEP_SUFFIXES

FIRST, LAST = "ISO-10303-21", "END-ISO-10303-21"
SECTIONS = ("HEADER", "DATA")

QUOTED = re.compile(r"'[^']*'")
NOT_FINITE = re.compile(r"[(,]\s*[-+]?(?:nan\w*|inf\w*|1\.#\w+)\s*[,)]", re.IGNORECASE)

NO_NAME = "Open CASCADE STEP translator"
"""Beginning of the names that OpenCASCADE gives to solids without one."""


def refuse_broken_step(path: Path) -> None:
    """Check that a file is a whole STEP file without NaN.

    Raises:
        MeshError: it is missing, empty, of another kind, stops too early, or has a number that is not finite.
    """
    require_suffix(path, "STEP", STEP_SUFFIXES)
    try:
        text = path.read_text(encoding="latin-1")  # any byte is a letter
    except FileNotFoundError as error:
        raise MeshError(f"{path}: no such file; a STEP file ({', '.join(STEP_SUFFIXES)}) is needed") from error
    except OSError as error:
        raise MeshError(f"{path}: cannot be read: {error.strerror or error}") from error
    if not text.lstrip("\xef\xbb\xbf \t\r\n").startswith(FIRST):
        raise MeshError(f"{path}: is not a STEP file: it does not begin with {FIRST}")
    if LAST not in text:
        raise MeshError(f"{path}: stops too early: it does not end with {LAST}; write it again")
    for section in SECTIONS:
        if not re.search(rf"\b{section}\s*[;(]", text):
            raise MeshError(f"{path}: is not a STEP file: it has no section {section}")
    # Names may read like numbers; blanks take their places, so that lines keep their numbers.
    wrong = NOT_FINITE.search(QUOTED.sub(lambda quoted: " " * len(quoted[0]), text))
    if wrong is not None:
        line, number = text.count("\n", 0, wrong.start()) + 1, wrong[0].strip("(), \t\r\n")
        raise MeshError(f"{path}: line {line} has the number {number}, which is not finite; write the file again")


def import_solids(gmsh: Any, path: Path) -> dict[int, str]:
    """Read the solids of a file [mm], each joined to another by a face that both share.

    Returns:
        For each solid, in the file's order, gmsh's number and its name, which is empty where the file gives none.

    Raises:
        MeshError: the file cannot be read, has no solid, or has solids that overlap or are not joined by faces.
    """
    # Always set: OpenCASCADE keeps the unit of an earlier session.
    gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
    occ = gmsh.model.occ
    try:
        occ.importShapes(str(path))
    except Exception as error:  # gmsh raises plain Exception
        raise MeshError(f"{path}: not readable as STEP: {' '.join(str(error).split())}") from error
    occ.synchronize()
    solids = gmsh.model.getEntities(3)
    if not solids:
        faces = len(gmsh.model.getEntities(2))
        raise MeshError(f"{path}: has no solid body, and {faces} face{'s' * (faces != 1)}; export the body as a solid")
    names = [_plain_name(gmsh.model.getEntityName(*solid)) for solid in solids]
    if len(solids) == 1:
        return {solids[0][1]: names[0]}
    volumes = [occ.getMass(*solid) for solid in solids]
    _, parts = occ.fragment(solids, [])
    occ.synchronize()
    for second, its in enumerate(parts):
        for first in range(second):
            common = set(parts[first]) & set(its)
            if common:
                amount = sum(occ.getMass(*part) for part in common)
                raise MeshError(
                    f"{path}: solids {first + 1} and {second + 1} overlap by {amount:.4g} mm^3; cut one from the other"
                )
    tags = [its[0][1] for its in parts]
    _refuse_loose_solids(gmsh, path, tags, volumes)
    return dict(zip(tags, names, strict=True))


def _refuse_loose_solids(gmsh: Any, path: Path, tags: list[int], volumes: list[float]) -> None:
    joined, waiting = set(), [tags[0]]
    while waiting:
        joined.add(tag := waiting.pop())
        faces = gmsh.model.getAdjacencies(3, tag)[1]
        waiting += {int(one) for face in faces for one in gmsh.model.getAdjacencies(2, face)[0]} - joined
    loose = [number for number, tag in enumerate(tags) if tag not in joined]
    if loose:
        sizes = ", ".join(f"{volume:.4g}" for volume in volumes)
        raise MeshError(
            f"{path}: has {len(tags)} solids, of {sizes} mm^3, and solid {loose[0] + 1} shares no face with those "
            "joined to solid 1; join them, or export one body alone"
        )


def _plain_name(label: str) -> str:
    """The last part of a label like "Shapes/assembly/stiff layer", as a name of a group: "stiff_layer"."""
    name = label.rpartition("/")[2]
    return "" if name.startswith(NO_NAME) else re.sub(r"[^\w.-]+", "_", name).strip("_")
