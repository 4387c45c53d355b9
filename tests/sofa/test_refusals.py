"""What is refused, in which words, and what is not refused since it moves nothing."""

from pathlib import Path

import pytest
from scenes_of_sofa import BODY, loaded

from taichisoft.errors import ControllerFailed, SceneError
from taichisoft_sofa.translation.translate import translate


@pytest.mark.parametrize(
    "name", ["VisualGrid", "LineAxis", "OglWhatever", "OffExporter", "MomentumMonitor", "SpotLight", "WriteState"]
)
def test_what_concerns_pictures_and_records_is_without_effect(tmp_path: Path, name: str) -> None:
    translation = translate(loaded(tmp_path, f"root.addObject({name!r}, size=10)"))
    assert translation.refused == []
    assert translation.ignored == {name: 1}
    exports = name.endswith("Exporter") or name == "WriteState"
    assert any("`taichisoft recording export`" in line for line in translation.departures) is exports


def test_a_serial_port_exchanges_nothing_and_says_so(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    translation = translate(
        loaded(
            tmp_path,
            """
            import serial.tools.list_ports
            assert serial.tools.list_ports.comports() == []
            port = serial.Serial("/dev/ttyUSB0", 115200, timeout=0.05)
            assert (port.readline(), port.write(b"150")) == (b"", 3)
            root.addObject("SerialPortBridgeGeneric", port="/dev/ttyUSB0", size=3).packetOut = [1, 2, 3]
            """,
        )
    )
    assert translation.refused == []
    assert any("SerialPortBridgeGeneric" in line and "exchanges nothing" in line for line in translation.departures)
    assert "nothing is sent or read" in caplog.text


def test_the_inverse_solver_is_refused_once_for_all_of_its_components(tmp_path: Path) -> None:
    translation = translate(
        loaded(
            tmp_path,
            """
            root.addObject("QPInverseProblemSolver", name="QP")
            root.addObject("PositionEffector")
            root.addObject("CableActuator")
            """,
        )
    )
    (line,) = translation.refused
    assert line.startswith("QPInverseProblemSolver '/QP' (")
    assert "scene.py, line 3): belongs to the inverse solver" in line
    assert "beside CableActuator, PositionEffector" in line
    assert "patented" in line


@pytest.mark.parametrize(("base", "word"), [("ForceField", "force field"), ("DataEngine", "engine")])
def test_computations_of_the_scenes_own_are_refused_where_they_are_used(tmp_path: Path, base: str, word: str) -> None:
    before = f"import Sofa.Core\nclass Own(Sofa.Core.{base}):\n    pass\n"
    assert translate(loaded(tmp_path, "pass", before)).refused == []
    (line,) = translate(loaded(tmp_path, "root.addObject(Own(name='own'))", before)).refused
    assert "'/own' (" in line
    assert "of the scene's own" in line
    assert word in line


def test_a_loop_of_the_scenes_own_is_refused_with_a_way_out(tmp_path: Path) -> None:
    way_out = (
        r"line 4: Sofa.Simulation.animate\(\) is a loop of the scene's own; .*`taichisoft run`.*Sofa.Core.Controller"
    )
    with pytest.raises(SceneError, match=way_out):
        loaded(tmp_path, "import Sofa\nSofa.Simulation.animate(root, 0.01)")
    before = """
    import Sofa.Core
    class Steps(Sofa.Core.Controller):
        def onAnimateBeginEvent(self, event):
            Sofa.Simulation.animate(self, 0.01)
    """
    tree = loaded(tmp_path, "root.addObject(Steps(name='steps'))", before)
    with pytest.raises(ControllerFailed, match=r"line 5: Sofa\.Simulation\.animate"):
        tree.animate_begin(0.01)


def test_components_are_found_by_the_names_of_other_versions(tmp_path: Path) -> None:
    """SOFA 25.12 renamed its constraint solver; scenes ask the root for it by either name."""
    tree = loaded(tmp_path, "root.addObject('BlockGaussSeidelConstraintSolver', maxIterations=7)")
    assert tree.root.GenericConstraintSolver.maxIterations.value == 7
    tree = loaded(tmp_path, "root.addObject('GenericConstraintSolver', name='mine')")
    with pytest.raises(AttributeError):
        tree.root.BlockGaussSeidelConstraintSolver  # noqa: B018


XML = """<?xml version="1.0"?>
<Node name="root" dt="0.02" gravity="0 -9.81 0">
  <DefaultAnimationLoop/>
  <Node name="child">
    <EulerImplicitSolver rayleighStiffness="0.1"/>
    <CGLinearSolver iterations="25" name="solver" tolerance="1e-9" threshold="1e-9"/>
    <RegularGridTopology name="grid" n="4 2 2" min="0 0 0" max="30 10 10"/>
    <Object type="MechanicalObject" name="dofs"/>
    <UniformMass totalMass="0.1"/>
    <FixedConstraint indices="0 4 8 12"/>
    <HexahedronFEMForceField name="FEM" youngModulus="4000" poissonRatio="0.3" method="large"/>
  </Node>
</Node>
"""


def test_a_scene_in_xml_is_read(tmp_path: Path) -> None:
    """Its values are texts, and its components have the lines on which they stand."""
    from taichisoft_sofa.loading import load_tree

    (tmp_path / "scene.scn").write_text(XML)
    tree = load_tree(tmp_path / "scene.scn")
    translation = translate(tree)
    assert not translation.refused
    assert translation.tables["time"]["step"] == 0.02
    assert translation.tables["gravity"] == [0.0, -9.81, 0.0]
    body = translation.tables["soft_bodies"]["child"]
    assert (body["element"], body["rayleigh_stiffness"], body["young_modulus"]) == ("hexahedral", 0.1, 4000.0)
    assert len(body["anchors"][0]["nodes"]) == 4
    assert str(tree.root.child.dofs.place).endswith("scene.scn, line 8")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<Node><A></Node>", "line 1: no scene in XML: mismatched tag"),
        ("<Node>\n<include href='a.xml'/></Node>", "line 2: includes 'a.xml'; write its nodes into this file instead"),
        ("<A/>", "line 1: begins with <A>"),
        ("<Node><A><B/></A></Node>", "<B> is inside a component"),
        ("<Node>\n<Wrong/></Node>", "line 2.: is not known here"),
    ],
)
def test_mistakes_in_xml_are_one_line(tmp_path: Path, text: str, message: str) -> None:
    from taichisoft import load_scene

    (tmp_path / "scene.scn").write_text(text)
    with pytest.raises(SceneError, match=message):
        load_scene(tmp_path / "scene.scn")


def test_meshes_are_found_in_the_data_path(tmp_path: Path) -> None:
    from taichisoft_sofa.loading import load_tree

    share = tmp_path / "share" / "mesh"
    share.mkdir(parents=True)
    (share / "one.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    loaded(tmp_path, "root.addObject('MeshOBJLoader', name='loader', filename='mesh/one.obj')", BODY)
    tree = load_tree(tmp_path / "scene.py", data_path=[tmp_path / "share"])
    translate(tree)
    assert len(tree.root.loader.position.value) == 3
    with pytest.raises(SceneError, match="nowhere: no such folder"):
        load_tree(tmp_path / "scene.py", data_path=[tmp_path / "nowhere"])
