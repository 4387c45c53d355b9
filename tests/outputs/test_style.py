"""What cannot be drawn is refused in one line that says what can."""

from dataclasses import asdict

import pytest

from taichisoft_outputs import Style
from taichisoft_outputs.drawing.style import StyleError


@pytest.mark.parametrize(
    ("choice", "complaint"),
    [
        ({"size": (1280, 8)}, "size 1280x8: width and height must be whole numbers from 16 to 8192 pixels"),
        ({"size": (640.5, 480)}, "size 640.5x480: width and height must be whole numbers"),
        ({"size": (640,)}, r"size \(640,\) must be 2 numbers"),
        ({"view": "back"}, "no view is called 'back'; there are: iso, front, top, orbit, follow:BODY"),
        ({"view": "follow:"}, "no view is called 'follow:'"),
        ({"opacity": 0.0}, "opacity 0 must be above 0 and at most 1"),
        ({"opacity": float("nan")}, "opacity nan must be above 0"),
        ({"colour_by": "heat"}, "cannot be coloured by 'heat'; there are: none, displacement, stress"),
        ({"background": "#12345"}, "background '#12345' must be written #rrggbb"),
        ({"background": (0.1, 0.2, 1.5)}, "red, green and blue must each be from 0 to 1"),
        ({"eye": (1.0, 2.0)}, r"eye \(1.0, 2.0\) must be 3 numbers"),
        ({"target": (0.0, 0.0, 0.0)}, "target needs an eye"),
        ({"eye": (1, 2, 3), "target": (1, 2, 3)}, "eye and target are one point"),
        ({"eye": (1, 2, float("inf"))}, "must be 3 numbers"),
    ],
)
def test_an_impossible_choice_is_named(choice, complaint):
    with pytest.raises(StyleError, match=complaint):
        Style(**choice)


def test_a_style_comes_back_from_what_json_makes_of_it():
    style = Style(size=(320, 180), eye=(1, 2, 3), background="#ff0080", surface="finger.stl")
    plain = {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(style).items()}
    assert Style(**plain) == style
    assert style.background_colour == pytest.approx((1.0, 0.0, 128 / 255))


def test_an_eye_takes_the_place_of_a_followed_body():
    assert Style(view="follow:cube").followed == "cube"
    assert Style(view="follow:cube", eye=(1, 2, 3)).followed is None
