"""Materials that plug-ins provide by name."""

from pathlib import Path

import pytest

from taichisoft import hookimpl, load_scene, register_plugin, scene_from_dict
from taichisoft.errors import PluginError, SceneError

RUBBER = {
    "name": "House rubber",
    "law": "yeoh",
    "coefficients": {"c10": 60.0, "c20": 1.2},
    "poisson_ratio": 0.499,
    "density": 1.07e-6,
    "highest_stretch": 2.5,
    "source": "our tension tests",
}


class Materials:
    """A plug-in with materials."""

    def __init__(self, **materials: object):
        self.materials = materials

    @hookimpl
    def taichisoft_materials(self) -> dict[str, object]:
        return self.materials


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    """A body and a region that name the plug-in's material and a shipped one."""
    path = tmp_path / "scene.toml"
    path.write_text("""
[soft_bodies.finger]
mesh = "tutorial-coarse"
material = "house-rubber"
element = "smoothed"

[[soft_bodies.finger.regions]]
box = [[-100.0, 22.5, -8.0], [-19.0, 28.0, 8.0]]
material = "dragon-skin-30"

[soft_bodies.other]
like = "finger"
material = "ecoflex-00-30"

[[soft_bodies.other.regions]]
box = [[-100.0, 22.5, -8.0], [-19.0, 28.0, 8.0]]
material = "house-rubber"
""")
    return path


def test_body_or_region_may_name_it(taichisoft_plugins, scene_file: Path) -> None:
    """E = 2 (1 + nu) 2 c10 = 359.76 kPa at rest."""
    register_plugin(Materials(**{"house-rubber": RUBBER}))
    bodies = load_scene(scene_file).soft_bodies
    assert bodies["finger"].young_moduli[0] == pytest.approx(359.76)
    assert bodies["other"].young_moduli[1] == pytest.approx(359.76)
    assert bodies["finger"].material is not None and bodies["finger"].material.highest_stretch == 2.5


def test_scene_in_tables_may_name_it(taichisoft_plugins) -> None:
    """The caller's tables stay as they are, so that they make a second scene."""
    register_plugin(Materials(**{"house-rubber": RUBBER}))
    tables = {"soft_bodies": {"finger": {"mesh": "tutorial-coarse", "material": "house-rubber"}}}
    for _ in range(2):
        assert scene_from_dict(tables).soft_bodies["finger"].young_moduli[0] == pytest.approx(359.76)
    assert tables["soft_bodies"]["finger"]["material"] == "house-rubber"


def test_without_plugin_there_is_none(scene_file: Path) -> None:
    with pytest.raises(SceneError, match="house-rubber"):
        load_scene(scene_file)


def test_wrong_material_names_the_plugin(taichisoft_plugins, scene_file: Path) -> None:
    register_plugin(Materials(**{"house-rubber": 3.0}))
    with pytest.raises(PluginError, match="must be a mapping with the keys of a material's file"):
        load_scene(scene_file)


def test_table_that_lacks_key_names_it(taichisoft_plugins, scene_file: Path) -> None:
    lacking = {key: value for key, value in RUBBER.items() if key != "density"}
    register_plugin(Materials(**{"house-rubber": lacking}))
    with pytest.raises(SceneError, match="density"):
        load_scene(scene_file)


def test_material_is_listed(taichisoft_plugins) -> None:
    from taichisoft_outputs.material_files import find_material

    register_plugin(Materials(**{"house-rubber": RUBBER}))
    assert find_material("house-rubber").shear_modulus == pytest.approx(120.0)
