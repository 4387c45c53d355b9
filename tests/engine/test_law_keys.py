"""Laws of elasticity in scenes: which keys go together, and the modulus at rest."""

from typing import Any

import pytest

from taichisoft import Scene
from taichisoft.errors import SceneError
from taichisoft.scene import scene_from_dict


def scene(**body: Any) -> Scene:
    return scene_from_dict(
        {"soft_bodies": {"f": {"mesh": "tutorial-coarse", "mass": 0.04, "poisson_ratio": 0.4, **body}}}
    )


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ({"law": "yeoh", "young_modulus": 100.0}, r'law = "yeoh" needs coefficients = { c10 } instead'),
        ({"law": "hooke", "coefficients": {"c10": 1.0}}, r'law = "hooke" takes young_modulus instead of coefficients'),
        (
            {"law": "yeoh", "coefficients": {"c10": 1.0, "c02": 1.0}},
            r'coefficients.c02: law = "yeoh" has c10, c20',
        ),
        ({"law": "mooney-rivlin", "coefficients": {"c10": 1.0}}, r'law = "mooney-rivlin" needs c01, too'),
        ({"law": "ogden", "coefficients": {"mu1": 1.0, "alpha1": 2.0, "mu2": 1.0}}, r"needs alpha2, too"),
        ({"law": "ogden", "coefficients": {"mu1": 1.0, "alpha1": -2.0}}, r"modulus at rest is -1 kPa; must be"),
        ({"law": "yeoh"}, r"exactly one of young_modulus, coefficients is needed; given: none"),
        ({"young_modulus": 1.0, "element": "smoothed", "poisson_ratio": -0.1}, r"must be 0 or more with element"),
        ({"young_modulus": 1.0, "corotation": "edges"}, r'"edges" is for element = "linear", not "smoothed"'),
    ],
)
def test_keys_that_do_not_fit_are_refused(body: dict[str, Any], expected: str) -> None:
    with pytest.raises(SceneError, match=expected):
        scene(**body)


def test_who_names_no_element_gets_smoothed_ones_and_sofas_rotations_go_with_linear_ones() -> None:
    assert scene(young_modulus=1.0).soft_bodies["f"].element == "smoothed"
    sofas = scene(young_modulus=1.0, element="linear", corotation="edges").soft_bodies["f"]
    assert (sofas.element, sofas.corotation) == ("linear", "edges")


def test_the_modulus_at_rest_follows_from_the_coefficients() -> None:
    """E = 2 (1 + nu) mu, with mu = 2 (c10 + c01), and half the sum of mu alpha; a region takes the body's ratio."""
    region = {"box": [[0, 0, 0], [1, 1, 1]], "law": "ogden", "coefficients": {"mu1": 20.0, "alpha1": 3.0}}
    made = scene(law="mooney-rivlin", coefficients={"c10": 10.0, "c01": 5.0}, regions=[region])
    assert made.young_moduli == pytest.approx({"f": 2 * 1.4 * 30.0, "f.regions.0": 2 * 1.4 * 30.0})
