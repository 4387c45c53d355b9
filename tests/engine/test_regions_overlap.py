"""Regions of a soft body that share elements."""

from collections.abc import Callable

import numpy as np

from taichisoft import make_model
from taichisoft.scene import lame_parameters, scene_from_dict


def test_the_later_region_wins_whole_also_with_what_it_does_not_give(block: Callable[..., str]) -> None:
    """Where both are, the second one's modulus and, since it gives none, the body's Poisson's ratio."""
    box = [[-100, -100, -100], [100, 100, 100]]
    regions = [{"box": box, "young_modulus": 900, "poisson_ratio": 0.1}, {"box": box, "young_modulus": 700}]
    body = {"mesh": block((2, 1, 1), (20.0, 10.0, 10.0)), "mass": 1, "young_modulus": 500, "poisson_ratio": 0.3}
    model = make_model(scene_from_dict({"soft_bodies": {"block": {**body, "regions": regions}}}))
    expected = lame_parameters(np.array([700.0]), np.array([0.3]))
    np.testing.assert_array_equal(model.soft_bodies[0].lame, np.repeat(expected, 12, axis=0))
