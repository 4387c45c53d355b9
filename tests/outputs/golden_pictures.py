"""Draws the pictures of `test_golden_pictures`: `python golden_pictures.py RECORDING FOLDER`.

`python golden_pictures.py` alone draws those that the tests compare with anew, into `golden/`; look at them then.
"""

import functools
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from bent_gripper import record_gripper
from PIL import Image

from taichisoft import Scene
from taichisoft_outputs import Recording, Style, read_recording
from taichisoft_outputs.drawing import camera, colouring, stage, surface_painter
from taichisoft_outputs.drawing.camera import PictureCamera
from taichisoft_outputs.drawing.drawer import Drawer
from taichisoft_outputs.drawing.stage import Stage

GOLDEN = Path(__file__).parent / "golden"
SIZE = (320, 180)
FRAMES = (0, 1, 2)

STYLES = {
    "iso": (Style(size=SIZE), 1),
    "front_stress": (Style(size=SIZE, view="front", colour_by="stress"), 2),
    "orbit_displacement": (Style(size=SIZE, view="orbit", colour_by="displacement", cavity_pressure=False), 2),
    "section": (Style(size=SIZE, view="front", colour_by="displacement", section="z=0", arrows=False), 2),
    "top_opaque": (Style(size=SIZE, view="top", opacity=1.0, background="#202830", arrows=False), 0),
}
"""Style and frame by the name of the picture."""

TUTORIAL = "tutorial"
"""The picture of the scene as SOFA's tutorial shows it."""


def as_in_the_tutorial(scene: Scene) -> Scene:
    """The scene with a red floor on a dark background, a blue cube, arrows for axes, and light from the left."""
    changed = scene.model_dump(exclude_none=True)
    for body in (*changed["soft_bodies"].values(), changed["rigid_bodies"]["cube"]):
        body["axes"] = True
    changed["rigid_bodies"]["cube"]["colour"] = "#2a52be"
    changed["obstacles"]["floor"]["colour"] = "#c8321e"
    changed["appearance"] = {"background": "#002b36", "light": [1.0, -2.0, 2.0]}
    return Scene.model_validate(changed)


def draw(recording: Recording, style: Style, frame: int, folder: Path, name: str) -> None:
    """Write one picture."""
    Image.fromarray(Drawer(recording, style, FRAMES).image(frame)).save(folder / f"{name}.png")


def broken(holder: object, attribute: str, change: Callable) -> Callable:
    """A drawing with one thing changed in a module or class."""

    def draw_broken(recording: Recording, folder: Path, name: str) -> None:
        whole = getattr(holder, attribute)
        setattr(holder, attribute, change(whole))
        try:
            draw(recording, *STYLES["iso"], folder, name)
        finally:
            setattr(holder, attribute, whole)

    return draw_broken


def shifted(fit: Callable) -> Callable:
    """A camera that stands where it should not."""

    def fit_shifted(*arguments: object) -> PictureCamera:
        camera = fit(*arguments)
        return PictureCamera(camera.eye + np.array([0.0, 40.0, 0.0]), camera.target, camera.up)

    return fit_shifted


def inverted(normals: Callable) -> Callable:
    """Normals that point inwards."""

    def inward(self: object, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        corners, outward = normals(self, vertices)
        return corners, -outward

    return inward


def with_colour(kind: str, colour: tuple[float, float, float]) -> Callable:
    """Another material."""
    return lambda plain: {**plain, kind: colour}


BROKEN = {
    "camera": broken(camera, "fit_camera", shifted),
    "normals": broken(surface_painter.SmoothNormals, "__call__", inverted),
    "inside_out": broken(surface_painter, "seen_from_front", lambda seen: lambda *at: ~seen(*at)),
    "black_silicone": broken(colouring, "PLAIN", with_colour("soft", (0.0, 0.0, 0.0))),
    "white_cube": broken(colouring, "PLAIN", with_colour("rigid", (1.0, 1.0, 1.0))),
    "opaque": broken(sys.modules[__name__], "STYLES", lambda styles: {"iso": (Style(size=SIZE, opacity=1.0), 1)}),
    "no_shadow": broken(stage, "DARKEST", lambda strength: 0.0),
    "no_signs": broken(
        sys.modules[__name__],
        "STYLES",
        lambda styles: {"iso": (Style(size=SIZE, arrows=False, axes=False, caption=False), 1)},
    ),
}
"""Drawings of "iso" with something wrong, by its name."""


def main() -> None:
    """Draw all pictures, or those to compare with anew."""
    # A process can have only one renderer; these drawings follow each other.
    surface_painter.Stage = functools.cache(Stage)  # type: ignore[misc, assignment]
    with TemporaryDirectory() as temporary:
        recording, folder = map(Path, sys.argv[1:]) if sys.argv[1:] else (record_gripper(Path(temporary)), GOLDEN)
        with read_recording(recording) as opened:
            for name, (style, frame) in STYLES.items():
                draw(opened, style, frame, folder, name)
            if folder != GOLDEN:
                for name, draw_broken in BROKEN.items():
                    draw_broken(opened, folder, f"broken_{name}")
        with read_recording(recording) as opened:
            opened.scene = as_in_the_tutorial(opened.scene)
            draw(opened, Style(size=SIZE), 1, folder, TUTORIAL)


if __name__ == "__main__":
    main()
