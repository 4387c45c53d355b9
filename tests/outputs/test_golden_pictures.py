"""Pictures look as they did when somebody last looked at them, and anything broken in them would be noticed."""

import os
from pathlib import Path

import numpy as np
import pytest
from bent_gripper import record_gripper
from golden_pictures import BROKEN, GOLDEN, STYLES, TUTORIAL
from PIL import Image
from scipy.ndimage import gaussian_filter, shift

from taichisoft.base import run_python
from taichisoft_outputs.drawing.colouring import AIR, SOFT

ALIKE = 0.93
"""Least similarity: other renderers put edges a fraction of a pixel elsewhere, and round colours otherwise."""


def read_image(path):
    return np.asarray(Image.open(path).convert("RGB"), dtype=float)


def similarity(first, second):
    """Structural similarity (Wang and others, 2004) of the least similar tenth of two images, 1 where they are equal.

    The mean over all would hardly notice what is wrong in a small part of a picture with much background.
    """

    def blur(image):
        return gaussian_filter(image, sigma=(1.5, 1.5, 0))

    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    mean1, mean2 = blur(first), blur(second)
    variance1, variance2 = blur(first**2) - mean1**2, blur(second**2) - mean2**2
    covariance = blur(first * second) - mean1 * mean2
    local = (2 * mean1 * mean2 + c1) * (2 * covariance + c2)
    local /= (mean1**2 + mean2**2 + c1) * (variance1 + variance2 + c2)
    worst = np.sort(local.mean(axis=2).ravel())[: local[..., 0].size // 10]
    return worst.mean()


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """Folder of the pictures, all drawn by one process."""
    folder = tmp_path_factory.mktemp("golden")
    script = Path(__file__).with_name("golden_pictures.py")
    found = {**os.environ, "PYTHONPATH": os.pathsep.join([str(script.parent), os.environ.get("PYTHONPATH", "")])}
    child = run_python([str(script), str(record_gripper(folder)), str(folder)], 300.0, found)
    assert not child.problem, child.problem
    return folder


@pytest.mark.parametrize("name", [*STYLES, TUTORIAL])
def test_a_picture_looks_as_it_did(drawn, name):
    assert similarity(read_image(drawn / f"{name}.png"), read_image(GOLDEN / f"{name}.png")) > ALIKE


def test_values_have_the_colours_of_the_bar(drawn):
    """Warm pixels are the finger's: all but lines, smoothed edges and arrows lie within 3 of 255 of the bar's colours.

    Light would move most of them away. The section shows walls of air at the highest pressure of the run in the last
    colour of the bar.
    """
    dense = np.stack(
        [np.interp(np.linspace(0, 4, 2000), np.arange(5), part) for part in 255 * np.array(SOFT).T], axis=1
    )
    for name in ("front_stress", "section"):
        picture = np.round(read_image(drawn / f"{name}.png")[:, :250]).reshape(-1, 3)
        warm = picture[picture[:, 0] - picture[:, 2] > 50]
        distance = np.linalg.norm(warm[:, None] - dense, axis=2).min(axis=1)
        assert len(warm) > 1000
        assert (distance <= 3.0).mean() > 0.75, name
    air = np.linalg.norm(picture - 255 * np.array(AIR[-1]), axis=1) <= 3.0
    assert air.sum() > 200, "but lines along its walls"


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_broken_does_not_look_alike(drawn, name):
    assert similarity(read_image(drawn / f"broken_{name}.png"), read_image(GOLDEN / "iso.png")) < ALIKE


def test_similarity_tolerates_what_renderers_do_differently():
    picture = read_image(GOLDEN / "iso.png")
    random = np.random.default_rng(0)
    assert similarity(picture, picture) == pytest.approx(1.0)
    assert similarity(picture, picture + random.integers(-2, 3, picture.shape)) > ALIKE
    assert similarity(picture, shift(picture, (0.2, 0.2, 0.0), order=1, mode="nearest")) > ALIKE
