"""One process draws as many frames as a video has without needing more and more memory."""

from bent_gripper import record_gripper

from taichisoft.child_process import run_python

LARGEST_GROWTH = 200.0 / 1000
"""[MB] a frame: a thousand frames may cost 200 MB."""

SCRIPT = """
import resource, sys
from pathlib import Path
from taichisoft_outputs.drawing.drawer import Drawer
from taichisoft_outputs.recording.reader import read_recording
from taichisoft_outputs.drawing.style import Style

def peak():  # [MB]
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024

with read_recording(sys.argv[1]) as recording:
    drawer = Drawer(recording, Style(size=(320, 180), view="orbit", colour_by="stress"), [0, 1, 2])
    for number in range(60):
        drawer.image(number % 3)
        if number == 19:
            before = peak()
Path(sys.argv[2]).write_text(str((peak() - before) / 40))
"""


def test_memory_does_not_grow_with_the_frames(tmp_path):
    growth = tmp_path / "growth"  # a file, because the renderer writes to standard output
    child = run_python(["-c", SCRIPT, str(record_gripper(tmp_path)), str(growth)], 120.0)
    assert not child.problem, child.problem
    assert float(growth.read_text()) < LARGEST_GROWTH
