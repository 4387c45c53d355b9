"""`taichisoft new gripper`: a scene to start from."""

import json
import math
import os
import warnings
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from taichisoft.base import say
from taichisoft.errors import MeshError

if TYPE_CHECKING:
    import numpy as np

OBJECT, LENGTH = 42.0, 105.0
"""Side of the cube that the gripper closes on, and the length of the finger that it suits [mm]."""
BELOW, ABOVE = 7.0, 1.0
"""Distance from the tips to the floor, and of the cube over it, its contact distance [mm]."""

SCENE = """\
# A gripper of {count} pneumatic fingers, written by `taichisoft new gripper`: change it as you like.
# Units: millimetre, kilogram, second; so forces are in mN, pressures and moduli in kPa. Gravity acts along -x.
title = "gripper of {count} fingers"
gravity = [-9810.0, 0.0, 0.0]

[time]
step = 0.01
duration = 8.0

[contact]
friction = 0.6

[controller]
name = "closed-loop"  # close until contact, regulate the force, lift; taichisoft plugins lists others

[limits]
lowest_pressure = 0.0
highest_pressure = 150.0
pressure_rate = 300.0
base_speed = 100.0
base_turning_speed = 180.0

[goal]
object = "cube"

[soft_bodies.finger]  # becomes finger1 to finger{count}
mesh = {mesh}  # {about}
element = "{elements}"  # {effect}
density = 1.1e-6
young_modulus = 500.0
poisson_ratio = 0.3
rayleigh_mass = 0.1
rayleigh_stiffness = 0.1
{placement}anchors = [{{ {anchor} }}]
cavities = {{ {cavities} }}
pattern = {{ count = {count}, axis = "x", centre = [0.0, {opening:g}, 0.0] }}
{layer}
[rigid_bodies.cube]
box = [{size:g}, {size:g}, {size:g}]
mass = 0.005
position = [{place:g}, {opening:g}, 0.0]

[obstacles.floor]
plane = {{ point = [{floor:g}, 0.0, 0.0], normal = [1.0, 0.0, 0.0] }}
"""
LAYER = """
[[soft_bodies.finger.regions]]  # the stiff layer that makes the finger bend
group = "stiff_layer"
young_modulus = 1500.0
"""


WISHES = {"preset": ', preset = "coarse"', "set": ", set = { close_inlets = true }"}
"""What a scene asks of a geometry, in TOML."""
LEAST_BEND = 0.3
"""Least motion of a finger's end aside, as a share of its longest motion, to count as a bend [-]."""


class FingerElements(StrEnum):
    """Elements of the fingers."""

    SMOOTHED = "smoothed"
    LINEAR = "linear"


EFFECTS = {
    FingerElements.SMOOTHED: "bends 70 % as far as with fine meshes; a step takes 3 times as long as of linear ones",
    FingerElements.LINEAR: "bends 30 % as far as with fine meshes; a step takes a third of the time of smoothed ones",
}
"""What the elements cost and gain on the coarse mesh of the tutorial's finger, see docs/elements.md."""


@dataclass(frozen=True)
class _Finger:
    """What a scene says of its fingers, and the size of one.

    Attributes:
        mesh: the value of the key `mesh`, and `about` what is to be known of it.
        placement: lines that turn and shift it, so that it hangs from x = 0 with its underside in y = 0.
        anchor, cavities: what is between the braces of these keys.
        length, width, height: along x, z and y, when it is placed so [mm].
        has_layer: whether it has the group "stiff_layer".
    """

    mesh: str
    about: str
    placement: str
    anchor: str
    cavities: str
    length: float
    width: float
    height: float
    has_layer: bool


def gripper(
    fingers: Annotated[int, typer.Option(help="Number of fingers.")] = 3,
    finger: Annotated[
        str, typer.Option(help="Name or file of a finger: dimensions (.toml), STEP, or a mesh (.msh, .vtk, .vtu).")
    ] = "tutorial",
    opening: Annotated[
        float | None,
        typer.Option(help="Distance from the axis to the fingers' undersides \\[mm]: 70, or what suits the finger."),
    ] = None,
    elements: Annotated[
        FingerElements, typer.Option(help=". ".join(f"{kind}: {effect}" for kind, effect in EFFECTS.items()) + ".")
    ] = FingerElements.SMOOTHED,
    base: Annotated[
        str | None,
        typer.Option(metavar="x=0", help="Flat face by which a finger is held; the most plausible if not given."),
    ] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write.")] = Path("gripper.toml"),
) -> None:
    """Write the scene of a gripper with some equal fingers in a circle around a cube."""
    from taichisoft.base import named_os_errors

    text = scene_text(fingers, finger, opening, elements, base, output.parent)
    if output.suffix != ".toml":
        raise MeshError(f"--output {output}: must end in .toml")
    if output.exists():
        raise MeshError(f"--output {output}: exists already; choose another name")
    with named_os_errors(output, MeshError):
        output.parent.mkdir(parents=True, exist_ok=True)
        output.write_text(text, encoding="utf-8")
    say(f"{elements} elements: {EFFECTS[elements]} (--elements {'|'.join(FingerElements)})")
    say(f"{output}: taichisoft run {output}")


def scene_text(
    count: int,
    finger: str,
    opening: float | None,
    elements: FingerElements,
    base: str | None = None,
    folder: Path = Path(),
) -> str:
    """The scene as TOML.

    Args:
        count: number of fingers.
        finger: name or file of a geometry, a STEP body or a mesh.
        opening: distance from the axis to the undersides [mm]; None: as suits the finger.
        elements: of the fingers.
        base: the plane of the face by which it is held, "x=0"; None: the most plausible.
        folder: where the scene goes.
    """
    if not 1 <= count <= 100:
        raise MeshError(f"--fingers {count}: must be from 1 to 100")
    its, size = _pneunet(finger, base, folder), OBJECT
    if its is None:
        its = _any_finger(finger, base, folder)
        size = float(f"{its.length * OBJECT / LENGTH:.2g}")
    # Neighbours touch at the corners of their undersides where half of the width is opening * tan(half of the angle).
    narrowest = its.width / 2.0 / math.tan(math.pi / count) if count > 2 else 0.0
    least = max(narrowest, size / math.sqrt(2.0)) + ABOVE
    if opening is None:
        opening = 70.0 if size == OBJECT else math.ceil(max(its.height + size, least + ABOVE))
    if not least < opening < 1000.0:
        raise MeshError(
            f"--opening {opening:g}: must be more than {least:.1f} mm for {count} fingers and below 1000 mm"
        )
    floor = -its.length - BELOW
    return SCENE.format(
        count=count,
        mesh=its.mesh,
        about=its.about,
        placement=its.placement,
        anchor=its.anchor,
        cavities=its.cavities,
        elements=elements,
        effect=EFFECTS[elements],
        opening=opening,
        layer=LAYER if its.has_layer else "",
        size=size,
        place=floor + size / 2.0 + ABOVE,
        floor=floor,
    )


def _pneunet(finger: str, base: str | None, folder: Path) -> _Finger | None:
    """The finger where it is of the kind `pneunet_finger`."""
    from taichisoft.mesh import SURFACE_SUFFIXES, VOLUME_SUFFIXES
    from taichisoft_meshing import mesh_commands
    from taichisoft_meshing.geometry_file import make_geometry
    from taichisoft_meshing.pneunet_finger import PneunetFinger, stiff_layer_box

    if Path(finger).suffix.lower() in (*VOLUME_SUFFIXES, *SURFACE_SUFFIXES):
        return None
    job = mesh_commands.geometry_job(finger, None, {})
    geometry = make_geometry(job.kind, job.tables, job.file)
    if not isinstance(geometry, PneunetFinger):
        return None
    if base is not None:
        raise MeshError(f"--base {base}: a pneunet_finger is held by its base, x = 0; leave it out")
    is_shipped = Path(finger).suffix != ".toml" and not Path(finger).exists()
    body = geometry.table.body
    return _Finger(
        f'{{ file = {json.dumps(f"{finger}.toml") if is_shipped else _named(job.file, folder)}, preset = "coarse" }}',
        f"its dimensions: taichisoft mesh {finger} --help",
        "",
        'group = "base"',
        'cavity = { group = "cavity" }',
        body.length,
        body.width,
        body.height,
        stiff_layer_box(geometry.table) is not None,
    )


def _any_finger(finger: str, base: str | None, folder: Path) -> _Finger:
    """Any other finger, by its mesh: it is held by its base, and turned so that it bends to the object."""
    import numpy as np
    from scipy.spatial.transform import Rotation

    from taichisoft.mesh import CAVITY, OUTER, SURFACE_SUFFIXES, named_surfaces, read_volume_mesh
    from taichisoft_meshing.geometry_file import STEP_SUFFIXES, is_geometry, read_geometry
    from taichisoft_meshing.mesh_commands import geometry_job
    from taichisoft_meshing.mesh_job import mesh_for_scene, read_step_apart

    if Path(finger).suffix.lower() in SURFACE_SUFFIXES:
        raise MeshError(f"--finger {finger}: is a surface; first `taichisoft mesh --surfaces {finger} -o finger.msh`")
    path = Path(finger).expanduser()
    request: dict[str, Any] = {}
    if is_geometry(finger) or not path.suffix:
        path = geometry_job(finger, None, {}).file
        geometry = read_geometry(path)
        if "coarse" in geometry.presets:
            request["preset"] = "coarse"
        if path.suffix.lower() in STEP_SUFFIXES and read_step_apart(path).openings:
            request["set"] = {"close_inlets": True}
        mesh = mesh_for_scene(path, **request)
    else:
        mesh = read_volume_mesh(path)
    surfaces = named_surfaces(mesh)
    chambers = [name for name in surfaces if name.startswith(CAVITY)]
    if not chambers:
        raise MeshError(
            f"--finger {finger}: has no chamber that pressure could fill; `taichisoft mesh info` lists them"
        )
    nodes, outer = mesh.nodes, surfaces[OUTER]
    normal, anchor = _base_of(finger, base, nodes, outer, surfaces)
    held = f"{{ file = {_named(path, folder)}{''.join(WISHES[key] for key in request)} }}"
    motion = _motion_of_tip({"file": str(path.resolve()), **request}, normal, anchor, chambers)
    across = np.eye(3)[np.abs(normal) < 0.5] if np.abs(normal).max() > 0.999 else np.linalg.svd(normal[None])[2][1:]
    side = max(
        (sign * axis for axis in across for sign in (1.0, -1.0)), key=lambda axis: round(float(axis @ motion), 3)
    )
    turn = np.array([normal, side, np.cross(normal, side)])
    placed = nodes @ turn.T
    lower, upper = placed.min(axis=0), placed.max(axis=0)
    shift = -np.array([upper[0], lower[1], (lower[2] + upper[2]) / 2])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # where two of the angles turn about the same axis
        angles = np.round(Rotation.from_matrix(turn).as_euler("xyz", degrees=True), 6) + 0.0
    rows = f"rotation = {angles.tolist()}\ntranslation = {(np.round(shift, 6) + 0.0).tolist()}\n"
    length, height, width = (upper - lower).tolist()
    bends = side @ motion > LEAST_BEND
    towards = f"bends towards {'+' if side.sum() > 0 else '-'}{'xyz'[np.abs(side).argmax()]} of its file"
    return _Finger(
        held,
        f"{len(nodes)} nodes; {towards if bends else 'hardly bends: turn it as you like'}",
        rows,
        anchor,
        ", ".join(f"{name} = {{ group = {json.dumps(name)} }}" for name in chambers),
        length,
        width,
        height,
        "stiff_layer" in mesh.element_groups,
    )


def _base_of(
    finger: str, base: str | None, nodes: "np.ndarray", outer: "np.ndarray", surfaces: "dict[str, np.ndarray]"
) -> "tuple[np.ndarray, str]":
    """The direction out of a finger at its base, a unit vector, shape (3,), and what its anchors select.

    It is the plane that is asked for, the group "base", or the larger flat end of its longest side.
    """
    import numpy as np

    from taichisoft.scene import BASE
    from taichisoft_meshing.closed_shells import NEAR, area_vectors, diagonal

    near, lower, upper = NEAR * diagonal(nodes), nodes.min(axis=0), nodes.max(axis=0)

    def area(axis: int, place: float) -> float:
        flat = (np.abs(nodes[outer][:, :, axis] - place) <= near).all(axis=1)
        return float(np.linalg.norm(area_vectors(nodes[outer][flat]), axis=1).sum())

    if base is None and BASE in surfaces:
        normal = area_vectors(nodes[surfaces[BASE]]).sum(axis=0)
        return normal / np.linalg.norm(normal), f'group = "{BASE}"'
    if base is None:
        axis = int((upper - lower).argmax())
        place = max((float(upper[axis]), float(lower[axis])), key=lambda end: area(axis, end))
        problem = "has no flat end; --base names the plane of another face, such as x=0"
    else:
        name, _, number = base.replace(" ", "").partition("=")
        try:
            axis, place = ("x", "y", "z").index(name.lower()), float(number)
        except ValueError as error:
            raise MeshError(f"--base {base}: must be an axis and a position in mm, such as x=0") from error
        ends = [f"{'xyz'[n]}={end:.6g}" for n in range(3) for end in (lower[n], upper[n]) if area(n, end) > 0]
        problem = f"has no flat face in {base}; its flat ends: {', '.join(ends) or 'none'}"
    if not area(axis, place) > 0 or lower[axis] + near < place < upper[axis] - near:
        raise MeshError(f"--finger {finger}: {problem}")
    corners = np.round(np.array([lower - 0.01, upper + 0.01]), 6)
    corners[:, axis] = np.round([place - 0.01, place + 0.01], 6)
    return (1.0 if place > (lower[axis] + upper[axis]) / 2 else -1.0) * np.eye(3)[axis], f"box = {corners.tolist()}"


def _motion_of_tip(mesh: dict[str, Any], normal: "np.ndarray", anchor: str, chambers: list[str]) -> "np.ndarray":
    """How the end of a finger moves by a small pressure in all chambers, as a share of its longest motion, (3,)."""
    import tomllib

    import numpy as np

    from taichisoft import Control, Simulation, scene_from_dict

    body = {
        "mesh": mesh,
        "element": "linear",
        "density": 1e-6,
        "young_modulus": 500.0,
        "poisson_ratio": 0.3,
        "rayleigh_stiffness": 0.1,
        "anchors": [tomllib.loads(anchor)],
        "cavities": {name: {"group": name} for name in chambers},
    }
    scene = scene_from_dict({"gravity": [0.0, 0.0, 0.0], "time": {"step": 0.05}, "soft_bodies": {"finger": body}})
    simulation = Simulation(scene)
    rest = simulation.state.position.copy()
    for _ in range(10):
        simulation.step(Control(pressure={f"finger.{name}": 0.1 for name in chambers}))
    heights, moved = rest @ normal, simulation.state.position - rest
    tip = heights < heights.min() + 0.05 * np.ptp(heights)
    motion: np.ndarray = moved[tip].mean(axis=0) / np.linalg.norm(moved, axis=1).max()
    return motion


def _named(file: Path, folder: Path) -> str:
    """A file as a scene in a folder names it, in TOML."""
    return json.dumps(Path(os.path.relpath(file.resolve(), folder.resolve())).as_posix())
