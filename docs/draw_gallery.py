"""Writes docs/gallery.md and its pictures: `python docs/draw_gallery.py`, some minutes.

Every picture is made by the commands that stand under it, in a folder that goes afterwards.
"""

import shlex
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

DOCS = Path(__file__).parent
SIZE = (640, 360)
HEAD = """# Gallery

<!-- Written by `python docs/draw_gallery.py`, which ran these commands. -->

Each picture with the commands that make it. All are drawn off screen, without a graphics card.
"""

RUNS = {
    "gripper": "taichisoft run gripper",
    "closed": "taichisoft run gripper --controller closed-loop --set rigid_bodies.cube.mass=0.02",
    "cables": "taichisoft run cable-gripper",
    "silicone": "taichisoft run gripper-dragon-skin",
    "inflated": "taichisoft run finger-inflated",
    "hanging": "taichisoft run finger-hanging",
    "layer": "taichisoft run finger-stiff-layer",
    "four": "taichisoft new gripper --fingers 4 -o four.toml && taichisoft run four.toml",
    "arm": "taichisoft run pick-and-place",
}
"""Commands that make the recordings, by the names of their folders in out/."""
PICTURES = (
    ("before", "Three fingers and a cube", "gripper", "--time 0"),
    ("closed", "Closed at 50 kPa, with the forces of contacts", "gripper", "--time 1.4"),
    ("lifted", "Lifted and held", "gripper", "--time 6"),
    ("stress", "Von Mises stress", "gripper", "--time 6 --colour-by stress"),
    ("strain", "The largest principal strain", "gripper", "--time 6 --colour-by strain"),
    ("displacement", "How far the silicone has moved", "gripper", "--time 6 --colour-by displacement"),
    ("section", "Cut through a finger and the cube", "gripper", "--time 6 --colour-by stress --section z=0"),
    ("top", "From above", "gripper", "--time 6 --view top"),
    ("close-up", "A close-up that follows the cube", "gripper", "--time 6 --follow cube"),
    ("dark", "For a dark hall", "gripper", "--time 6 --colour-by stress --background #101418 --font-size 18"),
    ("by-feel", "20 g, grasped by the force that the fingers feel", "closed", "--time 5"),
    ("cables", "Fingers that cables close", "cables", "--time 4"),
    ("tension", "The tension of the cables, fingers as glass", "cables", "--time 4 --opacity 0.3"),
    ("silicone", "Fingers of Dragon Skin", "silicone", "--time 6"),
    ("silicone-strain", "Where the rubber is stretched", "silicone", "--time 6 --colour-by strain"),
    ("silicone-section", "Inside its chambers", "silicone", "--time 6 --colour-by stress --section z=0"),
    ("inflated", "One finger, inflated", "inflated", "--time 1.5 --view front"),
    ("inflated-stress", "Its stress", "inflated", "--time 1.5 --view front --colour-by stress"),
    ("hanging", "A finger under its own weight", "hanging", "--time 1 --view front --colour-by displacement"),
    ("layer", "With a stiff layer in its back", "layer", "--time 1.5 --view front --colour-by stress"),
    ("four", "Four fingers, from one command", "four", "--time 5"),
    ("arm", "An arm reaches for a cube", "arm", "--time 1"),
    ("over-the-wall", "Over the wall", "arm", "--time 6"),
    ("side-by-side", "The same grasp in two materials", "gripper silicone", "--time 6 --side-by-side"),
)
"""Name, caption, recordings, and options of `taichisoft render`."""


def commands_of(recordings: str, options: str) -> list[str]:
    """The command lines that make a picture."""
    names = recordings.split()
    made = [f"{RUNS[name]} -o out/{name}" for name in names]
    return [
        *made,
        f"taichisoft render {' '.join(f'out/{name}/recording.h5' for name in names)} {quoted(options)} --image",
    ]


def quoted(options: str) -> str:
    """Options as a shell takes them: a colour begins with the sign of comments."""
    return shlex.join(options.split())


def run(line: str, folder: Path) -> None:
    """Run a command of this environment in a folder."""
    for part in line.split(" && "):
        program, *words = shlex.split(part)
        subprocess.run(
            [str(Path(sys.executable).parent / program), *words], cwd=folder, check=True, capture_output=True
        )


def main() -> None:
    """Draw the pictures and write the page."""
    (DOCS / "gallery").mkdir(exist_ok=True)
    with TemporaryDirectory() as folder:
        for name, line in RUNS.items():
            print(line, flush=True)
            run(f"{line} -o out/{name}", Path(folder))
        for name, _, recordings, options in PICTURES:
            print(name, flush=True)
            run(f"{commands_of(recordings, options)[-1]} --size {SIZE[0]}x{SIZE[1]} -o out/{name}", Path(folder))
            (drawn,) = (Path(folder) / "out" / name).rglob("*.png")
            Image.open(drawn).convert("RGB").save(DOCS / "gallery" / f"{name}.jpg", quality=88)
    write_page()


def write_page() -> None:
    """Write docs/gallery.md."""
    parts = [HEAD]
    for name, caption, recordings, options in PICTURES:
        lines = "\n".join(commands_of(recordings, options))
        parts.append(f"## {caption}\n\n![{caption}](gallery/{name}.jpg)\n\n```sh\n{lines}\n```\n")
    (DOCS / "gallery.md").write_text("\n".join(parts), encoding="utf-8")


if __name__ == "__main__":
    main()
