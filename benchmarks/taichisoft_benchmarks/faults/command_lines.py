"""Command lines with mistakes in them: wrong names, values and files."""

import random
import shutil
from pathlib import Path

from taichisoft_benchmarks.faults.mistaken_scenes import HUGE_INTEGER, NUMBERS, TEXTS, base_scene

DEEP_KEY = "a" + ".a" * 3000
FILES = ("scene.toml", "text.toml", "empty.h5", "text.h5", "text.msh", "text.stl", "folder", "nothing.h5", "pad.msh")
COMMANDS: dict[str, tuple[int, str]] = {
    "run": (1, "--controller --output --set --duration --outputs --speed --keys --web-address --goal"),
    "resume": (1, "--at --set --duration --output --outputs"),
    "render": (1, "--time --video --fps --size --view --eye --target --output --colour-by"),
    "view": (1, "--address"),
    "recording plot": (1, "--output --format --only"),
    "recording report": (1, "--output"),
    "recording export": (1, "--output"),
    "mesh": (1, "--output --set"),
    "mesh info": (1, ""),
    "mesh sweep": (1, "--output --set --vary"),
    "mesh cache": (0, ""),
    "materials": (1, "--output"),
    "plugins": (1, "--plugin --plugins-dir"),
    "sofa": (2, "--output"),
    "": (1, "--plugin --plugins-dir"),
}
"""Number of arguments, and options, of each command."""
KEYS = ("time.step", "contact.friction", "soft_bodies.left.mesh", "soft_bodies.left", "x", "title", "goal", DEEP_KEY)


def attempt(number: int) -> list[str]:
    """A command line with mistakes that neither runs for ever nor opens a page."""
    dice = random.Random(f"command {number}")
    texts = [text for text in TEXTS if "\0" not in text]
    values = [*map(str, NUMBERS), *texts, *FILES, HUGE_INTEGER, "í:8080", "x" * 300]
    name = dice.choice(list(COMMANDS))
    positional, options = COMMANDS[name]
    line = name.split()
    if name == "run" and dice.random() < 0.7:
        line += ["scene.toml", "--duration", "0.02"]
    else:
        line += [dice.choice(values) for _ in range(positional if dice.random() < 0.9 else dice.randrange(3))]
    for _ in range(dice.choice([0, 1, 1, 2])):
        if options:
            line.append(dice.choice(options.split()))
            if dice.random() < 0.95:
                line.append((f"{dice.choice(KEYS)}=" if line[-1] == "--set" else "") + dice.choice(values))
    return line


def write_files() -> None:
    """The files that command lines name."""
    import tomli_w

    document = base_scene()
    Path("scene.toml").write_text(tomli_w.dumps(document))
    shutil.copy(document["soft_bodies"]["left"]["mesh"], "pad.msh")
    for name in ("text.toml", "text.h5", "text.msh", "text.stl"):
        Path(name).write_text("It was a dark and stormy night.\n")
    Path("empty.h5").touch()
    Path("folder").mkdir()
