"""Record a run, draw pictures of it, and read the recording.

Outputs watch a run. `make_output` makes one by its name, as `taichisoft run --outputs recording,pictures` does; they
are asked in the order of the list, so that the recording is complete when the pictures are drawn from it. No display is
needed. `taichisoft recording render`, `plot`, `report` and `view` do more with the same recording.

Run it with a folder to keep the files: python examples/record_and_render.py out/record_and_render

Prints:

    completed: after.png, before.png, recording.h5
    0.1 s: 9.0 kPa
    0.2 s: 19.0 kPa
    0.4 s: 30.0 kPa
    after.png: 1280 x 720 pixels
"""

import sys
import tempfile
from pathlib import Path

from PIL import Image

import taichisoft
from taichisoft_outputs import read_recording

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
folder.mkdir(parents=True, exist_ok=True)

scene = taichisoft.load_scene("finger-inflated")
outputs = [taichisoft.make_output(name, folder) for name in ("recording", "pictures")]
outcome = taichisoft.run(
    taichisoft.Simulation(scene),
    taichisoft.make_controller(scene),  # the one that the scene names: it inflates the finger in 0.3 s
    outputs,
    duration=0.4,
)
print(f"{outcome}: {', '.join(sorted(path.name for path in folder.iterdir()))}")

with read_recording(folder / "recording.h5") as recording:
    pressure = recording.column("pressure")[:, 0]
    for time in (0.1, 0.2, 0.4):
        print(f"{time:.1f} s: {pressure[recording.instant_at(time)]:.1f} kPa")

with Image.open(folder / "after.png") as picture:
    print(f"after.png: {picture.width} x {picture.height} pixels")
