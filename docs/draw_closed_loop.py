"""Draws docs/notes/closed_loop.svg: `python docs/draw_closed_loop.py RUN [FILE.svg]`.

RUN is the folder of the run of sixty seconds that docs/notes/experiments.md describes, with its run.csv.
"""

import sys
import tomllib
from pathlib import Path

PANELS = {
    "force [mN]": {"signal set_point": "k--", "signal force": "-"},
    "pressure [kPa]": {"pressure finger1.cavity [kPa]": "-"},
    "height [mm]": {"signal height": "k--", "lift cube [mm]": "-"},
    "slip [mm/s]": {"signal slip_speed": "-"},
}
OFF_THE_GROUND = {3: "#dce9f5", 4: "#c6dbef", 5: "#c6dbef", 6: "#dce9f5"}
"""Colours of the phases lift, hold, held and lower."""


def draw(run: Path, file: Path) -> None:
    """Draw force, pressure, heights and slip of a run with four grasps."""
    import matplotlib
    import pandas
    from matplotlib.figure import Figure

    table = pandas.read_csv(run / "run.csv")
    phases = table.groupby((table["signal phase"].diff() != 0).cumsum())
    # Of four steps the one with the fastest slip is shown.
    table["signal slip_speed"] = table["signal slip_speed"].clip(lower=1e-3)
    shown = table.loc[table.groupby(table.index // 4)["signal slip_speed"].idxmax()]
    pushes = tomllib.loads((run / "scene.toml").read_text()).get("external_forces", [])

    matplotlib.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "taichisoft", "font.size": 9.0})
    figure = Figure(figsize=(9.0, 7.0), layout="constrained")
    for axes, (label, lines) in zip(figure.subplots(len(PANELS), sharex=True), PANELS.items(), strict=True):
        for column, style in lines.items():
            axes.plot(shown["time [s]"], shown[column], style, linewidth=1, label=column)
        for _, rows in phases:
            colour = OFF_THE_GROUND.get(rows["signal phase"].iloc[0], "none")
            axes.axvspan(rows["time [s]"].iloc[0], rows["time [s]"].iloc[-1], facecolor=colour, linewidth=0)
        for push in pushes:
            axes.axvspan(push["start"], push["start"] + push["duration"], color="tab:red", alpha=0.6, linewidth=0)
        axes.set_ylabel(label)
        axes.margins(x=0)
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, frameon=False)
    axes.set_yscale("log")
    axes.set_xlabel("time [s]")
    figure.savefig(file, metadata={"Date": None, "Creator": None})


if __name__ == "__main__":
    given = [Path(argument) for argument in sys.argv[1:]]
    draw(given[0], given[1] if given[1:] else Path(__file__).with_name("notes") / "closed_loop.svg")
