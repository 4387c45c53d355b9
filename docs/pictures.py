"""The pictures of the documents: `python docs/pictures.py COMMAND`; CONTRIBUTING.md names the command of each.

Runs and the gallery take some minutes, and are made by the shipped scenes. Figures of pages are small SVG files, drawn
from the folders of runs that the pages describe.
"""

import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from operator import attrgetter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import typer
from PIL import Image

from taichisoft import Observation, gradient, load_scene, make_controller
from taichisoft import run as run_simulation
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.running import Simulation
from taichisoft_meshing.finger_dimensions import FingerParameters, end, starts
from taichisoft_meshing.pneunet_finger import chamber_boxes, channel_box, slot_boxes, stiff_layer_box
from taichisoft_outputs.drawing.style import Style
from taichisoft_outputs.materials_command import plot
from taichisoft_outputs.recording.reader import read_recording
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.rendering.video import render_pictures, render_video

DOCS = Path(__file__).parent

application = typer.Typer(add_completion=False, help="Draw the pictures of the documents.")


@contextmanager
def svg_figure(file: Path, font_size: float = 9.0, **shape: Any) -> Iterator[Any]:
    """A figure that is written at the end, with text as text and fixed identities: it changes only with its content."""
    import matplotlib
    from matplotlib.figure import Figure

    style: Any = {"svg.fonttype": "none", "svg.hashsalt": "taichisoft", "font.size": font_size}
    with matplotlib.rc_context(style):
        figure = Figure(**shape)
        yield figure
        figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None})


# Runs of shipped scenes, two of them filmed.

SHOWN = {
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
        print(
            f"{name}: {run_simulation(simulation, make_controller(scene), [RecordingOutput(Path(folder))])}", flush=True
        )
        recording = Path(folder) / "recording.h5"
        render_pictures(recording, {name: scene.time.duration if time is None else time}, DOCS)
        if name == ANIMATED:
            render_video(recording, DOCS / f"{name}.gif", fps=13.0, slow_motion=0.5, style=Style(size=SIZE))
        if name == FILMED:
            render_video(recording, DOCS / f"{name}.mp4", fps=15.0, style=Style(size=FILM_SIZE))


@application.command("runs")
def draw_runs() -> None:
    """Draw the pictures of shipped scenes, and film two."""
    for name, (scene_name, time) in SHOWN.items():
        draw_run(name, scene_name, time)


@application.command("materials")
def draw_materials(measured: Path) -> None:
    """Draw materials.png from the tension tests of the Soft Robotics Materials Database, NAME.csv in MEASURED."""
    plot(data=measured, output=DOCS / "materials.png")


# The gallery, whose pictures are made by the commands that stand under them, in a folder that goes afterwards.

GALLERY_SIZE = "640x360"
HEAD = """# Gallery

<!-- Written by `python docs/pictures.py gallery`, which ran these commands. -->

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
    files = " ".join(f"out/{name}/recording.h5" for name in names)
    # A colour begins with the sign of comments.
    return [*made, f"taichisoft render {files} {shlex.join(options.split())} --image"]


def run(line: str, folder: Path) -> None:
    """Run a command of this environment in a folder."""
    for part in line.split(" && "):
        program, *words = shlex.split(part)
        subprocess.run(
            [str(Path(sys.executable).parent / program), *words], cwd=folder, check=True, capture_output=True
        )


@application.command("gallery")
def draw_gallery() -> None:
    """Write gallery.md and its pictures, each by the commands that stand under it."""
    (DOCS / "gallery").mkdir(exist_ok=True)
    with TemporaryDirectory() as folder:
        for name, line in RUNS.items():
            print(line, flush=True)
            run(f"{line} -o out/{name}", Path(folder))
        for name, _, recordings, options in PICTURES:
            print(name, flush=True)
            run(f"{commands_of(recordings, options)[-1]} --size {GALLERY_SIZE} -o out/{name}", Path(folder))
            (drawn,) = (Path(folder) / "out" / name).rglob("*.png")
            Image.open(drawn).convert("RGB").save(DOCS / "gallery" / f"{name}.jpg", quality=88)
    write_page()


def write_page() -> None:
    """Write docs/gallery.md."""
    parts = [HEAD]
    for name, caption, recordings, options in PICTURES:
        lines = "\n".join(commands_of(recordings, options))
        parts.append(f"## {caption}\n\n![](gallery/{name}.jpg)\n\n```sh\n{lines}\n```\n")
    (DOCS / "gallery.md").write_text("\n".join(parts), encoding="utf-8")


# Figures of pages.

PANELS = {
    "force [mN]": {"signal set_point": "k--", "signal force": "-"},
    "pressure [kPa]": {"pressure finger1.cavity [kPa]": "-"},
    "height [mm]": {"signal height": "k--", "lift cube [mm]": "-"},
    "slip [mm/s]": {"signal slip_speed": "-"},
}
OFF_THE_GROUND = {3: "#dce9f5", 4: "#c6dbef", 5: "#c6dbef", 6: "#dce9f5"}
"""Colours of the phases lift, hold, held and lower."""


@application.command("closed-loop")
def draw_closed_loop(run: Path, file: Path = DOCS / "notes" / "closed_loop.svg") -> None:
    """Draw force, pressure, heights and slip of the four grasps of docs/notes/experiments.md, from their run.csv."""
    import pandas

    table = pandas.read_csv(run / "run.csv")
    phases = table.groupby((table["signal phase"].diff() != 0).cumsum())
    # Of four steps the one with the fastest slip is shown.
    table["signal slip_speed"] = table["signal slip_speed"].clip(lower=1e-3)
    shown = table.loc[table.groupby(table.index // 4)["signal slip_speed"].idxmax()]
    pushes = tomllib.loads((run / "scene.toml").read_text()).get("external_forces", [])

    with svg_figure(file, figsize=(9.0, 7.0), layout="constrained") as figure:
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


@application.command("gradient")
def draw_gradient(file: Path = DOCS / "gradients.svg") -> None:
    """Draw what a wall and a grip make of objectives over a pressure, and gradients of the runs beside differences."""
    wall = "obstacles.wall={plane={point=[0.0,38.0,0.0],normal=[0.0,-1.0,0.0]}}"
    finger = load_scene("finger-inflated", (wall, "contact.friction=0.3", "contact.contact_distance=0.5"))
    gripper = load_scene(TINY_GRIPPER, ("limits={}", "contact.friction=0.4"))
    ramp = np.minimum(np.arange(40) / 15.0, 1.0)
    lift = {"base_translation.z": 15.0 * np.maximum(np.arange(40) / 20.0 - 1.0, 0.0)}
    pads = ("pressure.left.cavity", "pressure.right.cavity")
    pictures = (
        (finger, ("pressure.finger.cavity",), {}, ("tip_positions", "finger", 1), (6.0, 14.0), "finger to a wall: y"),
        (gripper, pads, lift, ("object_positions", "cube", 2), (5.0, 10.0), "cube lifted: height"),
    )
    with svg_figure(file, figsize=(8.0, 4.5), layout="constrained") as figure:
        for (above, below), picture in zip(figure.subplots(2, 2, sharex="col").T, pictures, strict=True):
            scene, names, others, (field, body, axis), ends, title = picture
            simulation, pressures = Simulation(scene), np.linspace(*ends, 41)

            def objective(seen: Observation, of: tuple[str, str, int] = (field, body, axis)) -> tuple[float, Any]:
                is_last = float(seen.step == len(ramp))
                return is_last * getattr(seen, of[0])[of[1]][of[2]], {f"{of[0]}.{of[1]}": is_last * np.eye(3)[of[2]]}

            controls = ({**dict.fromkeys(names, pressure * ramp), **others} for pressure in pressures)
            found = [gradient(simulation, one, objective, names) for one in controls]
            values = [one.value for one in found]
            above.plot(pressures, values)
            above.set_title(f"{title} [mm]", fontsize="medium")
            below.plot(pressures, np.gradient(values, pressures), ".", color="0.6", label="differences")
            below.plot(pressures, [sum(one[name] @ ramp for name in names) for one in found], label="gradient")
            below.set_title("slope [mm / kPa]", fontsize="medium")
            below.set_xlabel("pressure [kPa]")
            below.legend()


@application.command("slow-line")
def draw_slow_line(regulated: Path, line: Path, retuned: Path, file: Path = DOCS / "slow-line.svg") -> None:
    """Draw force and pressure of the runs of docs/air.md: regulated air, a slow line, and that with other settings."""
    runs = {"regulated air": regulated, "line": line, "line, retuned": retuned}
    with svg_figure(file, figsize=(8.0, 4.5), layout="constrained") as figure:
        force, pressure = figure.subplots(2, sharex=True)
        for label, run in runs.items():
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


SILICONE, STIFF, AIR, WALL = "#cfe3ee", "#9fc3d6", "#ffffff", "#a03010"
SCALE = 0.047
"""Inches of paper for a millimetre of the finger."""
ROW = 8.0
"""Distance between dimensions above each other, in the scale of the finger [mm]."""
GAP = 60.0
"""Distance from the base to the middle of the cross-section beside it, in the scale of the finger [mm]."""


@application.command("finger")
def draw_finger(file: Path = DOCS / "finger.svg") -> None:
    """Draw the tutorial's finger with the names of its dimensions: side view and cross-section, to scale."""
    finger = FingerParameters()
    left, right = -finger.body.length - 11, GAP + finger.body.width / 2 + 5
    low, high = -3.1 * ROW, finger.body.height + 5.2 * ROW
    with svg_figure(file, 6.5, figsize=(SCALE * (right - left), SCALE * (high - low))) as figure:
        axes = figure.add_axes((0, 0, 1, 1))
        axes.set_axis_off()
        axes.set_xlim(left, right)
        axes.set_ylim(low, high)
        for part in (_side_view, _lengths_above, _lengths_below, _heights, _walls, _roundings, _cross_section):
            part(axes, finger)


def _side_view(axes: Any, finger: FingerParameters) -> None:
    axes.fill(*zip(*finger.outline, strict=True), facecolor=SILICONE, edgecolor="black", linewidth=0.6)
    layer = stiff_layer_box(finger)
    if layer is not None:
        _rectangle(axes, *layer.corner[:2], *layer.size[:2], STIFF)
    for box in (*slot_boxes(finger), *chamber_boxes(finger), channel_box(finger)):
        _rectangle(axes, *box.corner[:2], *box.size[:2], AIR)


def _lengths_above(axes: Any, finger: FingerParameters) -> None:
    channel, chambers, layer, top = finger.channel, finger.chambers, finger.stiff_layer, finger.body.height
    begin, last = starts(chambers), end(chambers)
    for left, right, row, key in (
        (layer.end, 0, 4.4, "stiff_layer.end"),
        (channel.end, 0, 3.4, "channel.end"),
        (layer.start, 0, 2.4, "stiff_layer.start"),
        (channel.start, 0, 1.4, "channel.start"),
        (chambers.first, 0, 0.4, "chambers.first"),
        *([(begin[2], begin[1], 0.4, "chambers.pitch")] if chambers.count > 2 else []),
        (last, begin[-1], 0.4, "chambers.width"),
    ):
        _length(axes, -left, -right, top + row * ROW, top, _named(finger, key))
    axes.text(-(begin[0] + last) / 2, top + 1.5 * ROW, _named(finger, "chambers.count"), ha="center")


def _lengths_below(axes: Any, finger: FingerParameters) -> None:
    body, slots, begin = finger.body, finger.slots, starts(finger.slots)
    if slots.count:
        axes.text(-begin[0] - slots.width, -1.7 * ROW, _named(finger, "slots.count"), ha="center")
    for left, right, row, key in (
        *([(slots.first, 0, 0.8, "slots.first")] if slots.count else []),
        *([(end(slots), begin[-1], 0.8, "slots.width")] if slots.count else []),
        *([(begin[2], begin[1], 0.8, "slots.pitch")] if slots.count > 2 else []),
        (body.base_length, 0, 1.8, "body.base_length"),
        (body.length, body.length - body.taper_length, 1.8, "body.taper_length"),
        (body.length, 0, 2.8, "body.length"),
    ):
        _length(axes, -left, -right, -row * ROW, 0, _named(finger, key))


def _heights(axes: Any, finger: FingerParameters) -> None:
    body, slots, channel, chambers = finger.body, finger.slots, finger.channel, finger.chambers
    layer, low = finger.stiff_layer, finger.channel.bottom - finger.chambers.height
    for bottom, top, x, key in (
        (body.height - body.tip_height, body.height, -body.length - 7, "body.tip_height"),
        (0, channel.bottom, 5, "channel.bottom"),
        (0, channel.top, 12, "channel.top"),
        (0, layer.bottom, 19, "stiff_layer.bottom"),
        (0, body.height, 26, "body.height"),
        *([(0, slots.depth, -starts(slots)[1] - slots.width / 2, "slots.depth")] if slots.count > 1 else []),
        (low, channel.bottom, -chambers.first - chambers.width / 2, "chambers.height"),
    ):
        _arrow(axes, (x, bottom), (x, top))
        axes.text(x + 0.5, (bottom + top) / 2, _named(finger, key), ha="left", va="center", rotation=90)
    middle, bottom, top = -(layer.start + layer.end) / 2, layer.bottom, layer.bottom + layer.thickness
    _arrow(axes, (middle, bottom), (middle, top))
    axes.text(middle + 1, (bottom + top) / 2, _named(finger, "stiff_layer.thickness"), va="center")


def _walls(axes: Any, finger: FingerParameters) -> None:
    """Draw thicknesses that decide the positions above; without numbers, since they follow from these."""
    body, slots, channel, chambers = finger.body, finger.slots, finger.channel, finger.chambers
    low, style = channel.bottom - chambers.height, {"color": WALL, "va": "center", "ha": "right"}
    x = -end(chambers) - 6
    _arrow(axes, (x, channel.top), (x, body.height), WALL)
    axes.text(x - 1, (channel.top + body.height) / 2, "walls.back", **style)
    x = -starts(chambers)[chambers.count // 2] - chambers.width / 2
    _arrow(axes, (x, 0), (x, low), WALL)
    axes.text(x - 0.5, low / 2, "walls.floor", rotation=90, **style)
    if slots.count:
        x, side = -starts(slots)[-1] - slots.width / 2, -chambers.first - chambers.width
        _arrow(axes, (x, slots.depth), (x, channel.bottom), WALL)
        _note(axes, "walls.web", (x, channel.bottom), (x - 10, channel.top + 2.2), WALL)
        _arrow(axes, (-slots.first, low + 1), (side, low + 1), WALL)
        _note(axes, "walls.slot", (side, low + 1), (side + 6, low - 4), WALL)


def _roundings(axes: Any, finger: FingerParameters) -> None:
    """Draw fillets and the inlet, which the tutorial's finger has not."""
    slots, channel, chambers, inlet = finger.slots, finger.channel, finger.chambers, finger.inlet
    corner = (-end(chambers), channel.bottom - chambers.height)
    _note(axes, _named(finger, "chambers.fillet_radius"), corner, (-finger.body.length - 9, 3.0))
    if slots.count > 3:
        corner = (-starts(slots)[3] - slots.width, slots.depth)
        _note(axes, _named(finger, "slots.fillet_radius"), corner, (corner[0] - 9, -1.7 * ROW))
    middle = (channel.bottom + channel.top) / 2
    axes.plot([-channel.start, 1.5], [middle, middle], color="black", linewidth=0.4, dashes=(8, 3, 2, 3))
    axes.plot([-inlet.plug, -inlet.plug], [middle - 1, middle + 1], color="black", linewidth=0.8)
    axes.text(-inlet.plug, middle + 1.2, _named(finger, "inlet.plug"), ha="center", fontsize=5)
    axes.text(-0.5, middle - 1.2, _named(finger, "inlet.diameter"), ha="right", va="top", fontsize=5)


def _cross_section(axes: Any, finger: FingerParameters) -> None:
    """Draw the finger as seen along it, cut through a chamber."""
    body, channel, chambers, layer = finger.body, finger.channel, finger.chambers, finger.stiff_layer
    top, low = body.height, channel.bottom - chambers.height
    parts = (
        (0, body.height, SILICONE, -1.8 * ROW, 0, "body.width"),
        (layer.bottom, layer.thickness, STIFF, top + 1.4 * ROW, layer.bottom + layer.thickness, "stiff_layer.width"),
        (low, chambers.height, AIR, -0.8 * ROW, low, "chambers.depth"),
        (channel.bottom, channel.top - channel.bottom, AIR, top + 0.4 * ROW, channel.top, "channel.width"),
    )
    for bottom, height, colour, *_, key in parts:
        width = attrgetter(key)(finger)
        _rectangle(axes, GAP - width / 2, bottom, width, height, colour)
    for *_, y, from_y, key in parts:
        width = attrgetter(key)(finger)
        _length(axes, GAP - width / 2, GAP + width / 2, y, from_y, _named(finger, key))
    side = GAP + body.width / 2
    _arrow(axes, (GAP + chambers.depth / 2, low + 2), (side, low + 2), WALL)
    axes.text(side + 2, low + 2, "wall, or walls.side", color=WALL, rotation=90, va="bottom", ha="center")


def _named(finger: FingerParameters, key: str) -> str:
    """The text of a dimension, for example "body.width = 20"."""
    return f"{key} = {attrgetter(key)(finger):g}"


def _rectangle(axes: Any, x: float, y: float, width: float, height: float, colour: str) -> None:
    corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]
    axes.fill(*zip(*corners, strict=True), facecolor=colour, edgecolor="black", linewidth=0.6)


def _length(axes: Any, left: float, right: float, y: float, from_y: float, text: str) -> None:
    """Draw a dimension along the page at `y`, with thin lines that rise from what it measures at `from_y`."""
    for x in (left, right):
        axes.plot([x, x], [from_y, y], color="0.6", linewidth=0.3)
    _arrow(axes, (left, y), (right, y))
    axes.text((left + right) / 2, y + 0.5, text, ha="center", va="bottom")


def _arrow(axes: Any, start: tuple[float, float], stop: tuple[float, float], colour: str = "black") -> None:
    style = {"arrowstyle": "<->", "linewidth": 0.5, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 5, "color": colour}
    axes.annotate("", start, stop, arrowprops=style)


def _note(axes: Any, text: str, corner: tuple[float, float], place: tuple[float, float], colour: str = "black") -> None:
    """Write a text at a place, with a thin line to the corner of which it speaks."""
    line = {"arrowstyle": "-", "linewidth": 0.4, "shrinkA": 1, "shrinkB": 0, "color": colour}
    axes.annotate(text, corner, place, color=colour, arrowprops=line)


if __name__ == "__main__":
    application()
