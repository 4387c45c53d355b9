"""Draws pictures of runs of shipped scenes, and films two: `python docs/draw_pictures.py`, some minutes.

With `--measured DIR`, the tension tests of the Soft Robotics Materials Database (NAME.csv), also docs/materials.png.
"""

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

from taichisoft import load_scene, make_controller, run
from taichisoft.running import Simulation
from taichisoft_outputs.drawing.style import Style
from taichisoft_outputs.materials_command import plot
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.rendering.video import render_pictures, render_video

DOCS = Path(__file__).parent
RUNS = {
    "grasp": ("gripper", None),
    "grasp-dragon-skin": ("gripper-dragon-skin", None),
    "pick-and-place": ("pick-and-place", 4.7),
}
"""The shipped scene of each picture, and the time that it shows [s]; None: the end of the run."""
ANIMATED, FILMED = "grasp", "pick-and-place"
SIZE, FILM_SIZE = (800, 450), (640, 480)
"""Pixels of the animation and of the film, which are to stay under 3 MB."""


def draw_run(name: str, scene_name: str, time: float | None) -> None:
    """Run a shipped scene and draw a moment of it, or its end."""
    scene = load_scene(scene_name)
    simulation = Simulation(scene)
    with TemporaryDirectory() as folder:
        print(f"{name}: {run(simulation, make_controller(scene), [RecordingOutput(Path(folder))])}", flush=True)
        recording = Path(folder) / "recording.h5"
        render_pictures(recording, {name: scene.time.duration if time is None else time}, DOCS)
        if name == ANIMATED:
            draw_animation(recording, DOCS / f"{name}.gif")
        if name == FILMED:
            render_video(recording, DOCS / f"{name}.mp4", fps=15.0, style=Style(size=FILM_SIZE))


def draw_animation(recording: Path, target: Path, frames: int = 40, seconds: float = 4.0) -> None:
    """Write the first `seconds` of a grasp, its closing and lifting, as a GIF of three seconds."""
    times = {f"{i:03d}": seconds * (i + 1) / frames for i in range(frames)}
    with TemporaryDirectory() as folder:
        drawn = [Image.open(path) for path in render_pictures(recording, times, Path(folder), Style(size=SIZE))]
        palette = drawn[-1].convert("RGB").quantize(256, Image.Quantize.MAXCOVERAGE)
        images = [image.convert("RGB").quantize(palette=palette, dither=Image.Dither.NONE) for image in drawn]
        images[0].save(target, save_all=True, append_images=images[1:], duration=3000 // frames, loop=0, optimize=True)


def main() -> None:
    """Draw all pictures, those of measurements only where these are."""
    parser = argparse.ArgumentParser(prog="python docs/draw_pictures.py")
    parser.add_argument("--measured", type=Path, metavar="DIR", help="tension tests of materials, NAME.csv")
    arguments = parser.parse_args()
    for name, (scene_name, time) in RUNS.items():
        draw_run(name, scene_name, time)
    if arguments.measured is not None:
        plot(data=arguments.measured, output=DOCS / "materials.png")


if __name__ == "__main__":
    main()
