"""`taichisoft new gripper`: a scene to start from."""

import json
import math
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from taichisoft.base import say
from taichisoft.errors import MeshError

OBJECT = 42.0
"""Side of the cube that the gripper closes on [mm]."""
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
mesh = {{ file = {file}, preset = "coarse" }}  # its dimensions: taichisoft mesh {name} --help
element = "{elements}"  # {effect}
density = 1.1e-6
young_modulus = 500.0
poisson_ratio = 0.3
rayleigh_mass = 0.1
rayleigh_stiffness = 0.1
anchors = [{{ group = "base" }}]
cavities = {{ cavity = {{ group = "cavity" }} }}
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


class FingerElements(StrEnum):
    """Elements of the fingers."""

    SMOOTHED = "smoothed"
    LINEAR = "linear"


EFFECTS = {
    FingerElements.SMOOTHED: "bends 70 % as far as with fine meshes; a step takes 3 times as long as of linear ones",
    FingerElements.LINEAR: "bends 30 % as far as with fine meshes; a step takes a third of the time of smoothed ones",
}
"""What the elements cost and gain on the coarse mesh of the tutorial's finger, see docs/elements.md."""


def gripper(
    fingers: Annotated[int, typer.Option(help="Number of fingers.")] = 3,
    finger: Annotated[str, typer.Option(help="Name or file of a finger's dimensions (.toml).")] = "tutorial",
    opening: Annotated[float, typer.Option(help="Distance from the axis to the fingers' undersides \\[mm].")] = 70.0,
    elements: Annotated[
        FingerElements, typer.Option(help=". ".join(f"{kind}: {effect}" for kind, effect in EFFECTS.items()) + ".")
    ] = FingerElements.SMOOTHED,
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write.")] = Path("gripper.toml"),
) -> None:
    """Write the scene of a gripper with some equal fingers in a circle around a cube."""
    from taichisoft.base import named_os_errors

    text = scene_text(fingers, finger, opening, elements)
    if output.suffix != ".toml":
        raise MeshError(f"--output {output}: must end in .toml")
    if output.exists():
        raise MeshError(f"--output {output}: exists already; choose another name")
    with named_os_errors(output, MeshError):
        output.parent.mkdir(parents=True, exist_ok=True)
        output.write_text(text, encoding="utf-8")
    say(f"{elements} elements: {EFFECTS[elements]} (--elements {'|'.join(FingerElements)})")
    say(f"{output}: taichisoft run {output}")


def scene_text(count: int, finger: str, opening: float, elements: FingerElements) -> str:
    """The scene as TOML.

    Args:
        count: number of fingers.
        finger: name or file of a geometry of the kind pneunet_finger.
        opening: distance from the axis to the undersides [mm].
        elements: of the fingers.
    """
    from taichisoft_meshing import mesh_commands
    from taichisoft_meshing.geometry_file import make_geometry
    from taichisoft_meshing.pneunet_finger import PneunetFinger, stiff_layer_box

    if not 1 <= count <= 100:
        raise MeshError(f"--fingers {count}: must be from 1 to 100")
    job = mesh_commands.geometry_job(finger, None, {})
    geometry = make_geometry(job.kind, job.tables, job.file)
    if not isinstance(geometry, PneunetFinger):
        raise MeshError(f"--finger {finger}: kind = {job.kind!r}: must be pneunet_finger")
    body = geometry.table.body
    # Neighbours touch at the corners of their undersides where half of the width is opening * tan(half of the angle).
    narrowest = body.width / 2.0 / math.tan(math.pi / count) if count > 2 else 0.0
    least = max(narrowest, OBJECT / math.sqrt(2.0)) + ABOVE
    if not least < opening < 1000.0:
        raise MeshError(
            f"--opening {opening:g}: must be more than {least:.1f} mm for {count} fingers and below 1000 mm"
        )
    is_shipped = Path(finger).suffix != ".toml" and not Path(finger).exists()
    floor = -body.length - BELOW
    return SCENE.format(
        count=count,
        file=json.dumps(f"{finger}.toml" if is_shipped else str(job.file)),
        name=finger,
        elements=elements,
        effect=EFFECTS[elements],
        opening=opening,
        layer=LAYER if stiff_layer_box(geometry.table) is not None else "",
        size=OBJECT,
        place=floor + OBJECT / 2.0 + ABOVE,
        floor=floor,
    )
