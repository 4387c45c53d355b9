"""Draws docs/slow-line.svg: `python docs/draw_slow_line.py REGULATED LINE RETUNED [FILE.svg]`.

The three are folders of runs, as docs/air.md describes them: regulated air, a slow line, and that with other settings.
"""

import sys
from pathlib import Path

LABELS = ("regulated air", "line", "line, retuned")


def draw(runs: list[Path], file: Path) -> None:
    """Draw the force on the object, and the pressure of the first finger, of the runs."""
    import matplotlib
    from matplotlib.figure import Figure

    from taichisoft_outputs.recording.reader import read_recording

    matplotlib.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "taichisoft", "font.size": 9.0})
    figure = Figure(figsize=(8.0, 4.5), layout="constrained")
    force, pressure = figure.subplots(2, sharex=True)
    for label, run in zip(LABELS, runs, strict=True):
        with read_recording(run / "recording.h5") as recording:
            signals = dict(zip(recording.signals, recording.column("signals").T, strict=False))
            force.plot(recording.times, signals["force"], linewidth=1, label=label)
            pressure.plot(recording.times, recording.column("pressure")[:, 0], linewidth=1)
            force.plot(recording.times, signals["set_point"], "k--", linewidth=0.5)
    force.set_ylabel("force on the cube [mN]")
    force.legend(frameon=False)
    pressure.set_ylabel("pressure in a finger [kPa]")
    pressure.set_xlabel("time [s]")
    pressure.set_xlim(0.0, 5.0)
    figure.savefig(file, metadata={"Date": None, "Creator": None})


if __name__ == "__main__":
    given = [Path(argument) for argument in sys.argv[1:]]
    draw(given[:3], given[3] if given[3:] else Path(__file__).with_name("slow-line.svg"))
