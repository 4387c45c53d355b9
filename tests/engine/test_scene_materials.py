"""A material by name stands for keys of a soft body or region, and a resolved scene needs its file no longer."""

from pathlib import Path
from typing import Any

import pytest

from taichisoft import Scene
from taichisoft.errors import SceneError
from taichisoft.scene import scene_from_dict, scene_from_toml, scene_to_toml

RUBBER = """
name = "My rubber"
law = "yeoh"
coefficients = { c10 = 20.0, c20 = 1.5 }
poisson_ratio = 0.49
density = 1.1e-6
highest_stretch = 2.5
source = "measured by me"
"""


def scene(folder: Path | None = None, other: dict[str, Any] | None = None, **body: Any) -> Scene:
    bodies: dict[str, Any] = {"finger": {"mesh": "tutorial-coarse", **body}}
    if other is not None:
        bodies["other"] = {"like": "finger", **other}
    return scene_from_dict({"soft_bodies": bodies}, "scene.toml", folder)


def test_a_material_gives_what_the_body_does_not(tmp_path: Path) -> None:
    """At rest E = 2 (1 + nu) 2 c10 = 119.2 kPa; the body's own density or Poisson's ratio wins."""
    (tmp_path / "mine.toml").write_text(RUBBER)
    body = scene(tmp_path, material="mine.toml").soft_bodies["finger"]
    assert body.young_moduli == pytest.approx([119.2])
    assert (body.law, body.coefficients) == ("yeoh", {"c10": 20.0, "c20": 1.5})
    assert (body.poisson_ratio, body.density, body.mass) == (0.49, 1.1e-6, None)
    assert body.material is not None and body.material.coefficients == {"c10": 20.0, "c20": 1.5}
    own = scene(tmp_path, material="mine", poisson_ratio=0.4, mass=0.05).soft_bodies["finger"]
    assert (own.poisson_ratio, own.density, own.mass) == (0.4, None, 0.05)


def test_a_region_may_be_of_another_material() -> None:
    region = {"box": [[0, 0, 0], [1, 1, 1]], "material": "dragon-skin-30"}
    body = scene(material="ecoflex-00-30", regions=[region]).soft_bodies["finger"]
    assert body.young_moduli[1] > 5.0 * body.young_moduli[0]
    assert body.regions[0].poisson_ratio == 0.499


def test_a_body_like_another_may_have_another_material() -> None:
    """Or a Young's modulus of its own instead of one."""
    bodies = scene(material="ecoflex-00-30", other={"material": "dragon-skin-30"}).soft_bodies
    assert bodies["other"].young_moduli[0] > 5.0 * bodies["finger"].young_moduli[0]
    own = {"young_modulus": 300.0, "poisson_ratio": 0.3, "density": 1e-6}
    by_hand = scene(material="ecoflex-00-30", other=own).soft_bodies["other"]
    assert (by_hand.young_modulus, by_hand.material) == (300.0, None)
    plain = scene(**own, other={"material": "dragon-skin-30"}).soft_bodies["other"]
    assert (plain.poisson_ratio, plain.density) == (0.499, 1.07e-6)


def test_the_resolved_scene_holds_the_material(tmp_path: Path) -> None:
    """So that a recording can be gone on from where the material's file is not."""
    (tmp_path / "mine.toml").write_text(RUBBER)
    first = scene(tmp_path, material="mine.toml")
    (tmp_path / "mine.toml").unlink()
    assert scene_from_toml(scene_to_toml(first), "recorded") == first


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ({"material": "dragonskin-10"}, "soft_bodies.finger.material: dragonskin-10: no such file, and none of the"),
        ({"material": "dragonskin-10"}, "did you mean 'dragon-skin-10'?"),
        ({"material": 3}, "material = 3: must be the name of a material"),
        ({"material": "dragon-skin-10", "young_modulus": 5.0}, "young_modulus would have no effect beside material"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(body: dict[str, Any], expected: str) -> None:
    with pytest.raises(SceneError) as error:
        scene(**body)
    assert expected in str(error.value)
    assert "\n" not in str(error.value)


def test_a_material_that_is_not_valid_names_its_file(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(RUBBER.replace('law = "yeoh"', 'law = "gent"'))
    with pytest.raises(SceneError, match=r"mine\.toml: law: input should be 'hooke', 'neo-hookean'"):
        scene(tmp_path, material="mine.toml")
