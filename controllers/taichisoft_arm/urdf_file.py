"""An arm from a URDF: the chain of its joints, and the shapes of its links; yourdfpy parses the file."""

import os
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from taichisoft.base import extra, is_file, require, warn_caller
from taichisoft.errors import SceneError, nearest
from taichisoft_arm.kinematics import ChainJoint, KinematicChain

SUFFIX = ".urdf"
MM = 1000.0
USUAL_SPEED = {False: np.radians(90.0), True: 100.0}
"""Speed of a joint that turns, and of one that slides, whose speed the file does not give [rad/s], [mm/s]."""

NUMBERS = {"xyz": (3,), "rpy": (3,), "size": (3,), "rgba": (4,), "scale": (1, 3)} | dict.fromkeys(
    ("radius", "length", "lower", "upper", "velocity"), (1,)
)
"""How many numbers an attribute may have; yourdfpy takes any number of them."""
LARGEST = 1e6
"""Larger lengths [m] and angles [rad] are refused, and those that are not finite."""

FAR = 20.0
"""Lengths [m] and angles [rad] of an arm that are larger are probably in other units."""
ONCE = {
    "joint": ("parent", "child", "origin", "axis", "limit", "mimic"),
    "visual": ("origin", "geometry"),
    "collision": ("origin", "geometry"),
}
"""Elements that may be in others once; yourdfpy takes the first or the last of several."""
BESIDE = ("dynamics", "calibration", "safety_controller")
"""What else a joint may have, without effect here."""

ROS_PATHS = {"AMENT_PREFIX_PATH": "share", "ROS_PACKAGE_PATH": ""}
"""Variables in which ROS 2 and ROS 1 name folders, and what in these has a folder for each package."""

Look = Literal["visual", "collision"]


@dataclass(frozen=True)
class LinkPart:
    """A shape of a link.

    Attributes:
        link: name of the link.
        frame: number of the joints of the chain that move it, from 0 for what stands still.
        pose: pose in the frame behind that joint, shape (4, 4) [mm].
        shape: "box", "cylinder", "sphere" or "mesh".
        size: edge lengths of a box; radius and length of a cylinder; radius of a sphere; factors that make millimetres
            of the coordinates of a mesh.
        file: file of a mesh.
        colour: "#rrggbb", or None.
    """

    link: str
    frame: int
    pose: np.ndarray
    shape: str
    size: tuple[float, ...]
    file: Path | None = None
    colour: str | None = None


@dataclass(frozen=True)
class ArmDescription:
    """What a URDF says of an arm.

    Attributes:
        name: name of the arm.
        chain: joints from the root to the link that carries the gripper.
        parts: shapes of all links as they look, and as they collide.
    """

    name: str
    chain: KinematicChain
    parts: dict[Look, tuple[LinkPart, ...]]


def read_arm(path: Path, link: str | None = None) -> ArmDescription:
    """Read an arm.

    Joints that are not between the root and the link stay where they are at 0, or at the limit next to it; those that
    mimic another one are warned of.

    Args:
        path: the file.
        link: name of the link that carries the gripper; None: the only one to which nothing else is attached.
    """
    require(f"{path.name}", "yourdfpy", install=extra("arm"))
    robot = _parse(path)
    parents = {joint.child: joint for joint in robot.joints}
    _check_tree(robot, parents, path)
    _check_joints(robot, path)
    end = _end_link(robot, link, path)
    moving = [joint for joint in _way_to(end, parents) if joint.type != "fixed"]
    if not moving:
        raise SceneError(f"{path}: no joint moves the link '{end}'")
    numbers = {joint.name: number + 1 for number, joint in enumerate(moving)}
    _warn_of_mimics(robot, numbers, path)
    placed = {part.name: _placed(part.name, parents, numbers) for part in robot.links}
    joints = tuple(_chain_joint(joint, placed[joint.parent][1], path) for joint in moving)
    colours = {material.name: material for material in robot.materials}
    looks: tuple[Look, ...] = ("visual", "collision")
    parts = {
        look: tuple(
            _part(part.name, element, *placed[part.name], colours, path)
            for part in robot.links
            for element in (part.visuals if look == "visual" else part.collisions)
        )
        for look in looks
    }
    return ArmDescription(robot.name, KinematicChain(joints, placed[end][1]), parts)


def _parse(path: Path) -> Any:
    import yourdfpy
    from lxml import etree

    try:
        tree = etree.parse(path)  # yourdfpy would guess what a broken file means
        _check_numbers(tree, path)
        _check_elements(tree, path)
        robot = yourdfpy.URDF.load(str(path), build_scene_graph=False, load_meshes=False).robot
    except SceneError:
        raise
    except Exception as error:  # of any kind: yourdfpy takes it that what it looks for is there
        raise SceneError(f"{path}: not readable as URDF: {type(error).__name__}: {error}") from error
    if not robot.links:
        raise SceneError(f"{path}: has no links; a URDF that xacro makes must be written out first")
    return robot


def _check_numbers(tree: Any, path: Path) -> None:
    for element in tree.xpath("/robot/*[self::link or self::joint or self::material]//*"):
        for key in NUMBERS.keys() & element.attrib.keys():
            text = element.get(key)
            try:
                numbers = [float(word) for word in text.replace(",", " ").split()]
            except ValueError:
                numbers = []
            # A limit may be infinite, as that of a joint that turns without end.
            if len(numbers) not in NUMBERS[key] or not all(
                abs(number) < LARGEST or (element.tag == "limit" and number == number) for number in numbers
            ):
                count = " or ".join(map(str, NUMBERS[key]))
                raise SceneError(
                    f'{path}, line {element.sourceline}: {element.tag} has {key} = "{text}"; must be {count} finite '
                    f"number{'s' * (count != '1')}"
                )


def _check_elements(tree: Any, path: Path) -> None:
    for kind, once in ONCE.items():
        for element in tree.xpath(f"/robot/{kind}|/robot/link/{kind}"):
            where = f"{path}, line {element.sourceline}: {kind} '{element.get('name', '')}'"
            for tag in once:
                count = len(element.findall(tag))
                if count > 1 or (count == 0 and tag in ("parent", "child")):
                    raise SceneError(f"{where} has {count} of <{tag}>; must have one")
            tags = [inner.tag for inner in element if isinstance(inner.tag, str)]
            strange = [tag for tag in tags if tag not in (*once, *BESIDE)] if kind == "joint" else []
            if strange:
                warn_caller(
                    f"{where} has <{strange[0]}>, which has no effect; {nearest(strange[0], once, 'known are')}"
                )
    for element in tree.xpath("/robot/link|/robot/joint"):
        if not element.get("name"):
            raise SceneError(f"{path}, line {element.sourceline}: a {element.tag} has no name")
    for element in tree.xpath("/robot//origin|/robot/joint/axis"):
        strange = [key for key in element.attrib if key not in ("xyz", "rpy")]
        if strange:
            raise SceneError(f"{path}, line {element.sourceline}: {element.tag} has '{strange[0]}'; must be xyz or rpy")


def _check_joints(robot: Any, path: Path) -> None:
    """Refuse joints that have no motion, and warn of lengths and angles in other units."""
    for joint in robot.joints:
        where = f"{path}: joint '{joint.name}'"
        if joint.type in ("revolute", "continuous", "prismatic") and not _axis(joint).any():
            raise SceneError(f"{where}: its axis has no direction")
        if joint.type not in ("revolute", "prismatic") or joint.limit is None:
            continue
        low, high = joint.limit.lower or 0.0, joint.limit.upper or 0.0
        if low > high or low == np.inf or high == -np.inf:
            raise SceneError(f"{where}: its limits are {low:g} and {high:g}; the lower must be below the upper")
        far = max((abs(limit) for limit in (low, high) if np.isfinite(limit)), default=0.0)
        if far > FAR:
            units = ("rad", "degrees") if joint.type == "revolute" else ("m", "mm")
            warn_caller(f"{where}: has a limit of {far:g} {units[0]}; are its limits in {units[1]}?")
    lengths = {joint.name: float(np.linalg.norm(_origin(joint)[:3, 3])) / MM for joint in robot.joints}
    longest = max(lengths, key=lambda name: lengths[name], default="")
    if longest and lengths[longest] > FAR:
        warn_caller(f"{path}: joint '{longest}': its origin is {lengths[longest]:g} m away; are its lengths in mm?")


def _check_tree(robot: Any, parents: dict[str, Any], path: Path) -> None:
    names = [link.name for link in robot.links]
    for kind, given in (("links", names), ("joints", [joint.name for joint in robot.joints])):
        for name, count in Counter(given).items():
            if count > 1:
                raise SceneError(f"{path}: {count} {kind} are called '{name}'; each needs a name of its own")
    for joint in robot.joints:
        for name in (joint.parent, joint.child):
            if name not in names:
                known = nearest(str(name), names, "there are")
                raise SceneError(f"{path}: joint '{joint.name}': no link is called '{name}'; {known}")
        if parents[joint.child] is not joint:
            raise SceneError(f"{path}: two joints, '{joint.name}' and '{parents[joint.child].name}', move one link")
    if len([name for name in names if name not in parents]) != 1:
        roots = ", ".join(name for name in names if name not in parents) or "none"
        raise SceneError(f"{path}: needs one link that no joint moves; there are: {roots}")
    for name in names:
        above: list[str] = []
        while name in parents:
            if name in above:
                raise SceneError(f"{path}: links move one another in a circle: {', '.join(above[above.index(name) :])}")
            above.append(name)
            name = parents[name].parent


def _end_link(robot: Any, link: str | None, path: Path) -> str:
    names = [one.name for one in robot.links]
    if link is not None:
        if link not in names:
            raise SceneError(f"{path}: no link is called '{link}'; {nearest(link, names, 'there are')}")
        return link
    inner = {joint.parent for joint in robot.joints}
    ends = [name for name in names if name not in inner]
    if len(ends) != 1:
        raise SceneError(f"{path}: which link carries the gripper? give its name as link; ends are: {', '.join(ends)}")
    return ends[0]


def _way_to(link: str, parents: dict[str, Any]) -> list[Any]:
    """The joints from the root to a link."""
    joints = []
    while link in parents:
        joints.append(parents[link])
        link = parents[link].parent
    return joints[::-1]


def _placed(link: str, parents: dict[str, Any], numbers: dict[str, int]) -> tuple[int, np.ndarray]:
    """The number of the chain's joint that moves a link, 0 for the root's, and the link's pose behind it [mm]."""
    number, pose = 0, np.eye(4)
    for joint in _way_to(link, parents):
        if joint.name in numbers:
            number, pose = numbers[joint.name], np.eye(4)
        else:
            pose = pose @ _origin(joint) @ _resting(joint)
    return number, pose


def _warn_of_mimics(robot: Any, numbers: dict[str, int], path: Path) -> None:
    """Warn of joints beside the chain that would move as another joint does."""
    still = [
        f"'{joint.name}' ('{joint.mimic.joint}')" for joint in robot.joints if joint.mimic and joint.name not in numbers
    ]
    if still:
        warn_caller(
            f"{path}: joints that are not between the root and the gripper's link do not move, nor do those that mimic "
            f"another one: {', '.join(still)}; their links stay where they are at 0"
        )


def _origin(element: Any) -> np.ndarray:
    """The origin of a joint or a shape, its place in mm."""
    pose = np.eye(4) if element.origin is None else np.array(element.origin, dtype=np.float64)
    pose[:3, 3] *= MM
    return pose


def _resting(joint: Any) -> np.ndarray:
    """The motion of a joint that the arm does not drive, at 0 or at the limit next to it."""
    if joint.type not in ("revolute", "prismatic") or joint.limit is None:
        return np.eye(4)
    value = float(np.clip(0.0, joint.limit.lower or 0.0, joint.limit.upper or 0.0))
    slides = joint.type == "prismatic"
    still = ChainJoint(joint.name, slides, np.eye(4), _axis(joint), value, value, 1.0)
    return KinematicChain((still,), np.eye(4)).link(np.array([value * MM if slides else value]))


def _axis(joint: Any) -> np.ndarray:
    axis = np.array([1.0, 0.0, 0.0] if joint.axis is None else joint.axis, dtype=np.float64)
    length = np.linalg.norm(axis)
    return axis / length if length > 0.0 else axis


def _chain_joint(joint: Any, before: np.ndarray, path: Path) -> ChainJoint:
    """A joint of the chain; `before` leads from the frame of the joint before it to its parent link."""
    where = f"{path}: joint '{joint.name}'"
    if joint.type not in ("revolute", "continuous", "prismatic"):
        raise SceneError(
            f"{where}: type '{joint.type}' cannot be driven; revolute, continuous, prismatic and fixed can"
        )
    if joint.mimic is not None:
        raise SceneError(f"{where}: moves as '{joint.mimic.joint}' does; a joint of the arm must move by itself")
    axis, slides, limit = _axis(joint), joint.type == "prismatic", joint.limit
    unit = MM if slides else 1.0
    lowest, highest = -np.inf, np.inf
    if joint.type != "continuous":
        if limit is None:
            raise SceneError(f"{where}: has no limits; give them, or make it continuous")
        lowest, highest = unit * (limit.lower or 0.0), unit * (limit.upper or 0.0)
        if not (np.isfinite([lowest, highest]).all() and lowest < highest):
            raise SceneError(
                f"{where}: its limits are {limit.lower} and {limit.upper}; must be finite, the lower below the upper"
            )
    speed = unit * (limit.velocity or 0.0) if limit is not None else 0.0
    if not np.isfinite(speed) or speed <= 0.0:
        speed = USUAL_SPEED[slides]
        usual = f"{speed:g} mm/s" if slides else f"{np.degrees(speed):g} degrees/s"
        warn_caller(f"{where}: has no limit of its velocity above 0; {usual} is taken")
    return ChainJoint(joint.name, slides, before @ _origin(joint), axis, lowest, highest, speed)


def _part(link: str, element: Any, frame: int, before: np.ndarray, colours: dict[str, Any], path: Path) -> LinkPart:
    """A visual or a collision of a link that stands at `before` in a frame."""
    shape, size, file = _shape(element.geometry, f"{path}: link '{link}'", path)
    material = getattr(element, "material", None)
    if material is not None and material.color is None:
        material = colours.get(material.name)
    colour = None
    if material is not None and material.color is not None:
        shades = np.round(255.0 * np.clip(material.color.rgba[:3], 0.0, 1.0)).astype(int)
        colour = "#{:02x}{:02x}{:02x}".format(*shades)
    return LinkPart(link, frame, before @ _origin(element), shape, size, file, colour)


def _shape(geometry: Any, where: str, path: Path) -> tuple[str, tuple[float, ...], Path | None]:
    sizes: tuple[float, ...] = ()
    if geometry is not None and geometry.box is not None:
        shape, sizes = "box", tuple(MM * float(edge) for edge in geometry.box.size)
    elif geometry is not None and geometry.cylinder is not None:
        shape, sizes = "cylinder", (MM * geometry.cylinder.radius, MM * geometry.cylinder.length)
    elif geometry is not None and geometry.sphere is not None:
        shape, sizes = "sphere", (MM * geometry.sphere.radius,)
    elif geometry is not None and geometry.mesh is not None and geometry.mesh.filename:
        scale = 1.0 if geometry.mesh.scale is None else geometry.mesh.scale
        factors = tuple(MM * float(factor) for factor in np.broadcast_to(scale, 3))
        if 0.0 in factors:
            raise SceneError(f"{where}: the scale of its mesh must not be 0")
        return "mesh", factors, _mesh_file(geometry.mesh.filename, where, path)
    else:
        raise SceneError(f"{where}: has a shape that is none of box, cylinder, sphere, mesh with a filename")
    if min(sizes) <= 0.0:
        raise SceneError(f"{where}: the sizes of its {shape} must be above 0")
    return shape, sizes, None


def _mesh_file(name: str, where: str, path: Path) -> Path:
    """The file of a mesh: beside the URDF, or, for package://NAME/..., below a folder above it, or where ROS looks.

    A folder above that has the package's name, or is the package itself, is where its files lie.
    """
    plain = name.split("://", 1)[-1]
    folders, tails = [path.parent], [plain]
    if name.startswith("package://"):
        tails = [plain, plain.partition("/")[2]]
        folders = [*path.parents, *_ros_folders()]
    for folder in folders:
        for tail in tails:
            if is_file(folder / tail):
                return (folder / tail).resolve()
    shown = f"{path.parent}{' and above' if len(folders) > 1 else ''}"
    unset = "" if len(folders) == 1 else f"; {' and '.join(ROS_PATHS)} name no folder that has it"
    raise SceneError(f"{where}: the file of its mesh, {name}, is not there; it is looked for in {shown}{unset}")


def _ros_folders() -> list[Path]:
    return [
        Path(folder) / below
        for variable, below in ROS_PATHS.items()
        for folder in os.environ.get(variable, "").split(os.pathsep)
        if folder
    ]
