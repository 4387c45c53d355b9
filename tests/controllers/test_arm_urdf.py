"""Arms of users: meshes in files, mounts, links beside the chain, and what of a URDF is refused."""

import copy
import os
import warnings

import numpy as np
import pytest
import trimesh
from arms import STANDING, own_arm
from lxml import etree

from taichisoft import Simulation, scene_from_dict
from taichisoft.base.rotations import rotation_from_degrees
from taichisoft.errors import SceneError
from taichisoft_arm.arm_links import arm_bodies
from taichisoft_arm.mounted_arm import ArmPlacement, MountedArm
from taichisoft_arm.urdf_file import read_arm

MESH = '<{look}><origin xyz="0.01 0 0"/><geometry><mesh filename="{file}" scale="{scale}"/></geometry></{look}>'


def settings(urdf, **changes):
    return {"urdf": str(urdf), "position": [100.0, 0.0, 0.0], "joints": [90.0, 50.0], **changes}


def test_links_with_meshes_stand_where_the_joints_put_them(tmp_path):
    """A cube of 20 mm in metres, a sheet without thickness; their frames move as the joints do.

    The arm stands at x = 100 mm, is turned by 90 degrees about z and raised by 50 mm at the start: a link that is at
    (110, 0, 0) in the frame of the second joint is at (100, 110, 100) in the scene.
    """
    trimesh.creation.box((0.02, 0.02, 0.02)).export(tmp_path / "cube.stl")
    sheet = trimesh.Trimesh([[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 4]], [[0, 1, 2], [0, 1, 3]])
    (tmp_path / "meshes").mkdir()
    sheet.export(tmp_path / "meshes" / "sheet.stl")
    urdf = own_arm(
        tmp_path,
        upper=MESH.format(look="visual", file="package://own/cube.stl", scale="1 1 2"),
        lower=MESH.format(look="visual", file="meshes/sheet.stl", scale="0.001 0.001 0.001"),
        foot='<visual><geometry><sphere radius="0.03"/></geometry></visual>',
    )
    tables = arm_bodies(settings(urdf), tmp_path)
    bodies = tables["rigid_bodies"]
    assert {name: table["follows"] for name, table in bodies.items()} == {
        "arm_foot": "arm_root",
        "arm_lower": "arm_turn",
        "arm_upper": "base",
    }
    assert list(tables["frames"]) == ["arm_root", "arm_turn"]
    assert bodies["arm_foot"]["sphere"] == {"radius": 30.0}
    assert bodies["arm_upper"]["position"] == pytest.approx([100.0, 110.0, 100.0], abs=1e-9)
    assert rotation_from_degrees(bodies["arm_upper"]["rotation"]) @ [1, 0, 0] == pytest.approx([0, 1, 0], abs=1e-12)
    simulation = Simulation(scene_from_dict({"controller": {"name": "none"}, **tables, "base_pivot": [0.0, 0.0, 0.0]}))
    upper, lower = simulation.model.rigid_bodies[2], simulation.model.rigid_bodies[1]
    assert np.ptp(upper.vertices, axis=0) == pytest.approx([20.0, 20.0, 40.0], rel=1e-5)  # in single precision
    assert len(lower.triangles) == 2  # it stays open


def test_meshes_lie_in_packages_of_ros(tmp_path, monkeypatch):
    """Where ROS 2 installs a package, and in a workspace of ROS 1; else the error says where was looked."""
    own = tmp_path / "own"
    own.mkdir()
    urdf = own_arm(own, upper=MESH.format(look="visual", file="package://maker/meshes/cube.stl", scale="1 1 1"))
    for variable, folder in (("AMENT_PREFIX_PATH", "ros/share/maker"), ("ROS_PACKAGE_PATH", "ros/maker")):
        monkeypatch.setenv(variable, os.pathsep.join([str(tmp_path / "nothing"), str(tmp_path / "ros")]))
        with pytest.raises(SceneError, match="own and above; AMENT_PREFIX_PATH and ROS_PACKAGE_PATH name no folder"):
            read_arm(urdf, "mount")
        cube = tmp_path / folder / "meshes" / "cube.stl"
        cube.parent.mkdir(parents=True)
        trimesh.creation.box((0.02, 0.02, 0.02)).export(cube)
        assert [part.file for part in read_arm(urdf, "mount").parts["visual"]] == [cube.resolve()]
        cube.unlink()


def test_the_gripper_hangs_on_the_mount(tmp_path):
    """The link `mount` carries it; the pose of the link at the start is what the settings say, 1e-9 mm."""
    urdf = own_arm(tmp_path)
    mount = {"position": [100.0 + 120.0, 0.0, 100.0], "rotation": [180.0, 0.0, 0.0]}
    placed = ArmPlacement.model_validate({**settings(urdf), "joints": None, "mount": mount})
    arm = MountedArm(placed)
    assert arm.start == pytest.approx([0.0, 60.0], abs=1e-9)
    motion = arm.motions(arm.values_of([90.0, 80.0], "joints"))[-1]
    assert motion @ [220.0, 0.0, 90.0, 1.0] == pytest.approx([100.0, 120.0, 110.0, 1.0], abs=1e-9)


def test_link_in_the_middle_may_carry_the_gripper(tmp_path):
    jaw = '<link name="jaw"/><joint name="grip" type="prismatic"><parent link="mount"/><child link="jaw"/>'
    jaw += '<axis xyz="0 1 0"/><limit lower="0.01" upper="0.03" velocity="1" effort="1"/></joint>'
    urdf = own_arm(tmp_path, more=jaw)
    with pytest.raises(SceneError, match="which link carries"):
        read_arm(
            own_arm(
                tmp_path,
                more=jaw + '<link name="x"/><joint name="y" type="fixed"><parent link="foot"/>'
                '<child link="x"/></joint>',
            )
        )
    urdf = own_arm(tmp_path, more=jaw)
    chain = read_arm(urdf, "mount").chain
    assert [joint.name for joint in chain.joints] == ["turn", "slide"]
    at_mount = chain.link(np.zeros(2))
    jaw_chain = read_arm(urdf).chain  # the jaw is the end; it would move with three joints
    assert [joint.name for joint in jaw_chain.joints] == ["turn", "slide", "grip"]
    assert jaw_chain.link(np.array([0.0, 0.0, 10.0])) == pytest.approx(
        at_mount @ [[1, 0, 0, 0], [0, 1, 0, 10.0], [0, 0, 1, 0], [0, 0, 0, 1]]
    )


LIMIT = '<limit velocity="1.0" effort="1"/>'


@pytest.mark.parametrize(
    ("change", "said"),
    {
        ("</robot>", ""): "not readable as URDF: XMLSyntaxError",
        ('type="prismatic"', 'type="floating"'): "joint 'slide': type 'floating' cannot be driven",
        ('lower="-0.05" upper="0.2"', 'lower="0.2" upper="0.2"'): "joint 'slide': its limits are 0.2 and 0.2; must be",
        ('<parent link="foot"/>', '<parent link="food"/>'): "joint 'turn': no link is called 'food'; did you mean",
        ('<axis xyz="0 0 2"/>', '<axis xyz="0 0 0"/>'): "joint 'turn': its axis has no direction",
        (LIMIT, LIMIT + '<mimic joint="slide"/>'): "joint 'turn': moves as 'slide' does",
        ('<child link="lower"/>', '<child link="upper"/>'): "two joints, 'turn' and 'slide', move one link",
        ('<link name="mount"/>', '<link name="mount"/><link name="loose"/>'): "needs one link that no joint moves",
        ('type="continuous"', 'type="revolute"'): "joint 'turn': its limits are None and None",
        ('name="slide"', 'name="turn"'): "2 joints are called 'turn'",
        ('<link name="mount"/>', '<link name="mount"/><link name="mount"/>'): "2 links are called 'mount'",
        ('<parent link="upper"/>', '<parent link="mount"/>'): "links move one another in a circle: mount",
        ('xyz="0 0 0.05"', 'xyz="0.05"'): 'own.urdf, line 7: origin has xyz = "0.05"; must be 3 finite numbers',
    }.items(),
)
def test_what_cannot_be_driven_is_refused(tmp_path, change, said):
    path = own_arm(tmp_path)
    path.write_text(path.read_text().replace(*change))
    with pytest.raises(SceneError, match=r"own\.urdf[:,]") as refused:
        read_arm(path)
    assert said in str(refused.value) and len(str(refused.value).splitlines()) == 1


def test_any_broken_part_is_refused_or_harmless(tmp_path):
    """Every attribute gets a value that it must not have; every element is taken out, and written twice."""
    look = '<visual><origin xyz="0 0 0.01" rpy="0 0 1"/><geometry>{}</geometry><material name="red">'
    look += '<color rgba="1 0 0 1"/></material></visual>'
    trimesh.creation.box((1.0, 1.0, 1.0)).export(tmp_path / "cube.stl")
    jaw = '<link name="jaw"/><joint name="grip" type="prismatic"><parent link="mount"/><child link="jaw"/>'
    jaw += '<limit lower="0.01" upper="0.03" velocity="1"/><axis xyz="0 1 0"/></joint>'
    text = own_arm(
        tmp_path,
        foot=look.format('<box size="0.1 0.1 0.1"/>') + look.format('<sphere radius="0.1"/>'),
        lower=look.format('<cylinder radius="0.1" length="0.2"/>'),
        upper=look.format('<mesh filename="cube.stl" scale="0.01 0.01 0.01"/>'),
        more=jaw,
    ).read_text()
    places = [(number, key) for number, one in enumerate(etree.fromstring(text).iter()) for key in one.attrib]
    bad = ("", "nan", "inf", "-1", "0", "1e999", "1e308", "1 2", "1 2 3 4", "0 nan 0", "turn", "mount", "x" * 300)
    changes = [(number, key, value) for number, key in places for value in (*bad, None)]
    elements = {number for number, _ in places} - {0}
    changes += [(number, "", change) for number in elements for change in ("cut", "twice")]
    for number, key, change in changes:
        root = etree.fromstring(text)
        element = list(root.iter())[number]
        if not key and change == "twice":
            element.addnext(copy.deepcopy(element))
        elif not key:
            element.getparent().remove(element)
        elif change is None:
            del element.attrib[key]
        else:
            element.set(key, change)
        (tmp_path / "own.urdf").write_bytes(etree.tostring(root))
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                bodies = arm_bodies(settings("own.urdf", link="mount"), tmp_path)["rigid_bodies"]
        except SceneError as refused:
            assert len(str(refused).splitlines()) == 1
        else:
            numbers = [value for body in bodies.values() for value in (*body["position"], *body["rotation"])]
            assert np.isfinite(numbers).all(), (element.tag, key, change)


BESIDE = '<link name="jaw"/><joint name="grip" type="revolute"><parent link="mount"/><child link="jaw"/>{}</joint>'


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (('<origin xyz="0.1 0 0"/>', '<origin xyz="0.1 0 0"/><origin xyz="9 0 0"/>'), "'slide' has 2 of <origin>"),
        (('<parent link="lower"/>', '<parent link="foot"/><parent link="lower"/>'), "'slide' has 2 of <parent>"),
        (('<parent link="lower"/>', ""), "'slide' has 0 of <parent>"),
        (('name="slide" ', ""), "a joint has no name"),
        (('<origin xyz="0.1 0 0"/>', '<origin XYZ="0.1 0 0"/>'), "origin has 'XYZ'; must be xyz or rpy"),
        (
            ("</robot>", BESIDE.format('<limit lower="inf" upper="inf"/>') + "</robot>"),
            "'grip': its limits are inf and",
        ),
        (("</robot>", BESIDE.format('<limit lower="1" upper="-1"/>') + "</robot>"), "'grip': its limits are 1 and -1"),
        (("</robot>", BESIDE.format('<axis xyz="0 0 0"/>') + "</robot>"), "'grip': its axis has no direction"),
    ],
)
def test_parts_that_are_doubled_missing_or_void_are_refused(tmp_path, change, said):
    path = own_arm(tmp_path)
    path.write_text(path.read_text().replace(*change))
    with pytest.raises(SceneError, match=r"own\.urdf[:,]") as refused:
        read_arm(path, "mount")
    assert said in str(refused.value) and "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (('<origin xyz="0.1 0 0"/>', '<orgin xyz="0.1 0 0"/>'), "has <orgin>, which has no effect"),
        (('<origin xyz="0.1 0 0"/>', '<origin xyz="100 0 0"/>'), "are its lengths in mm"),
        (('lower="-0.05" upper="0.2"', 'lower="-50" upper="200"'), "are its limits in mm"),
        (("</robot>", BESIDE.format('<limit lower="-90" upper="90"/>') + "</robot>"), "are its limits in degrees"),
    ],
)
def test_what_is_probably_misspelt_or_in_other_units_is_told(tmp_path, change, said):
    path = own_arm(tmp_path)
    path.write_text(path.read_text().replace(*change))
    with pytest.warns(UserWarning, match=said):
        read_arm(path, "mount")


def test_a_mimic_joint_beside_the_chain_is_told(tmp_path):
    jaw = '<link name="jaw"/><joint name="grip" type="prismatic"><parent link="mount"/><child link="jaw"/>'
    jaw += '<limit lower="0" upper="0.03" velocity="1" effort="1"/><mimic joint="slide" multiplier="2"/></joint>'
    with pytest.warns(UserWarning, match=r"do not move, nor do those that mimic another one: 'grip' \('slide'\)"):
        read_arm(own_arm(tmp_path, more=jaw), "mount")


def test_a_joint_without_a_speed_gets_the_usual_one(tmp_path):
    path = own_arm(tmp_path)
    path.write_text(path.read_text().replace('velocity="1.0" ', ""))
    with pytest.warns(UserWarning, match="joint 'turn': has no limit of its velocity above 0; 90 degrees/s is taken"):
        assert read_arm(path).chain.speed[0] == np.radians(90.0)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"mount": {"position": [900.0, 0.0, 0.0]}}, "mount.position = [900.0, 0.0, 0.0]: the arm's link cannot be"),
        ({"mount": None, "joints": [1.0]}, "joints has 1 values; the arm has 6 joints: joint_1, "),
        ({"mount": None, "joints": [0, 0, 99, 0, 0, 0]}, "joint_3 = 99: must be from -200.02 to 70.01"),
        ({"mount": None}, "exactly one of mount, joints is needed"),
        ({"link": "flang"}, "no link is called 'flang'; did you mean 'flange'?"),
        ({"urdf": "seven-axis"}, "none of the shipped arms: six-axis"),
        ({"links": "shown"}, "links"),
    ],
)
def test_impossible_settings_are_refused_with_the_scene(tmp_path, changes, said):
    given = {key: value for key, value in {**STANDING, **changes}.items() if value is not None}
    tables = {
        "controller": {"name": "arm", "settings": given},
        "rigid_bodies": {"cube": {"box": [1.0] * 3, "mass": 1.0}},
    }
    with pytest.raises(SceneError) as refused:
        scene_from_dict(tables, "my scene")
    assert str(refused.value).startswith("my scene: ") and said in str(refused.value)
