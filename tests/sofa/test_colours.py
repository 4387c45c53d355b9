"""The colours of SOFA scenes arrive in the native tables."""

from pathlib import Path

import pytest
from blocks import make_block
from scenes_of_sofa import BODY, loaded

from taichisoft import write_volume_mesh
from taichisoft.scene import scene_from_dict
from taichisoft_sofa.components.visuals import NAMED
from taichisoft_sofa.scene_reader import with_files_in
from taichisoft_sofa.translation.parts import Translation
from taichisoft_sofa.translation.translate import translate

VISUAL = """
def visual(node, mapping, **colour):
    child = node.addChild("Visual")
    child.addObject("MeshOBJLoader", name="loader", filename="mesh/cube.obj")
    child.addObject("OglModel", src="@loader", **colour)
    child.addObject(mapping)

def cube(root, name, solver, **shown):
    node = root.addChild(name)
    if solver:
        node.addObject("EulerImplicitSolver")
        node.addObject("CGLinearSolver")
        node.addObject("UncoupledConstraintCorrection")
    node.addObject("MechanicalObject", template="Rigid3", **shown)
    node.addObject("UniformMass", totalMass=0.1)
    surface(node, "mesh/cube.obj", mapping="RigidMapping")
    return node
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a block's mesh."""
    write_volume_mesh(make_block((2, 1, 1), (20.0, 10.0, 10.0)), tmp_path / "block.vtk")
    return tmp_path


def translated(folder: Path, create: str) -> Translation:
    return translate(loaded(folder, create, BODY + VISUAL))


def test_soft_bodies_rigid_bodies_obstacles_and_the_background_have_their_colours(folder: Path) -> None:
    translation = translated(
        folder,
        """
        collisions(root)
        root.addObject("BackgroundSetting", color=[0, 0.168627, 0.211765, 1])
        root.addObject("OglSceneFrame", style="Arrows", alignment="TopRight")
        visual(body(root, "finger"), "BarycentricMapping", color="0.0 0.7 0.7 0.6")
        visual(cube(root, "cube", True), "RigidMapping", color=[0.0, 0.1, 0.5])
        visual(cube(root, "floor", False), "RigidMapping", color="red")
        visual(cube(root, "plain", False), "RigidMapping")
        """,
    )
    assert not translation.refused
    tables = translation.tables
    assert tables["soft_bodies"]["finger"]["colour"] == "#00b2b2"
    assert tables["rigid_bodies"]["cube"]["colour"] == "#001a80"
    assert tables["obstacles"]["floor"]["colour"] == "#ff0000"
    assert "colour" not in tables["obstacles"]["plain"]
    assert tables["appearance"] == {"background": "#002b36", "frame": True}
    translation.files.write(folder)
    scene = scene_from_dict(with_files_in(folder, tables))
    assert scene.appearance.background == "#002b36" and scene.obstacles["floor"].colour == "#ff0000"


def test_only_rigid_bodies_that_show_their_pose_have_axes(folder: Path) -> None:
    """Of a soft body `showObject` shows the points; something that stands still has no axes."""
    translation = translated(
        folder,
        """
        collisions(root)
        body(root, "finger").dofs.showObject = True
        cube(root, "cube", True, showObject=True, showObjectScale=30)
        cube(root, "other", True)
        cube(root, "floor", False, showObject=True)
        """,
    )
    assert not translation.refused
    bodies = {
        name: body
        for kind in ("soft_bodies", "rigid_bodies", "obstacles")
        for name, body in translation.tables[kind].items()
    }
    assert {name for name, body in bodies.items() if body.get("axes")} == {"cube"}


@pytest.mark.parametrize(
    ("given", "colour"),
    [
        ("'#1a2B3c'", "#1a2b3c"),
        ("'#1a2b3cff'", "#1a2b3c"),
        ("' Gray '", NAMED["gray"]),
        ("[1.2, -0.1, 0.5]", "#ff0080"),
        ("'#f80'", "#ff8800"),
    ],
)
def test_colours_are_numbers_names_or_digits(folder: Path, given: str, colour: str) -> None:
    translation = translated(folder, f"body(root)\nroot.addObject('BackgroundSetting', color={given})")
    assert not translation.refused
    assert translation.tables["appearance"] == {"background": colour}


@pytest.mark.parametrize("given", ["'dark red'", "[1, 0]", "'#12'", "[0, 0, float('nan')]"])
def test_what_is_no_colour_is_told_in_one_line(folder: Path, given: str) -> None:
    translation = translated(folder, f"body(root)\nroot.addObject('BackgroundSetting', color={given})")
    assert not translation.refused and "appearance" not in translation.tables
    (line,) = (line for line in translation.departures if "colour" in line)
    assert line.startswith("BackgroundSetting '/") and line.endswith("is not a colour; it gets the usual one")


def test_a_frame_that_is_not_drawn_is_not_in_pictures(folder: Path) -> None:
    assert "appearance" not in translated(folder, "body(root)").tables
    tables = translated(folder, "body(root)\nroot.addObject('OglSceneFrame', draw=False)").tables
    assert tables["appearance"] == {"frame": False}


@pytest.mark.parametrize(
    ("given", "eye", "target"),
    [
        ("position=[300, 20, 10], lookAt='0 0 5'", [300.0, 20.0, 10.0], [0.0, 0.0, 5.0]),
        ("position='300 20 10'", [300.0, 20.0, 10.0], None),
        ("lookAt='0 0 5'", None, None),
    ],
)
def test_a_camera_stands_where_the_scene_says(
    folder: Path, given: str, eye: list[float] | None, target: list[float] | None
) -> None:
    translation = translated(folder, f"body(root)\nroot.addObject('InteractiveCamera', name='camera', {given})")
    appearance = translation.tables.get("appearance", {})
    assert (appearance.get("eye"), appearance.get("target")) == (eye, target)
