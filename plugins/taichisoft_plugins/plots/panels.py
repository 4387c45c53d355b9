"""The curves of a run: one small panel for each quantity, made from the recording's columns."""

from collections.abc import Callable, Sequence
from functools import cached_property, partial

import numpy as np

from taichisoft.bodies.strain import Stretches
from taichisoft_plugins.base_motion import last_at_rest
from taichisoft_plugins.plots.figure import Curve, Panel, pieces
from taichisoft_plugins.plots.fingertips import TipMotion, tip_motion
from taichisoft_plugins.recording.reader import Recording

TIME_AXIS = "time [s]"
STRETCH_FRAMES = 100
"""Frames, at most, whose elements are looked at: there may be thousands of frames."""


class RunCurves:
    """Makes the panels of a recording."""

    def __init__(self, recording: Recording):
        """Prepare; tips are read when they are asked for."""
        self.recording = recording
        self.times = recording.times

    @cached_property
    def tips(self) -> TipMotion:
        """Motion of the tips, which several panels share."""
        return tip_motion(self.recording)

    @cached_property
    def sideways(self) -> tuple[tuple[str, np.ndarray], tuple[str, np.ndarray]]:
        """Names and directions of two horizontal axes."""
        up = self.recording.scene.up
        if np.isclose(np.abs(up).max(), 1.0):
            vertical = int(np.argmax(np.abs(up)))
            first, second = ((vertical + 1) % 3, (vertical + 2) % 3)
            return ("xyz"[first], np.eye(3)[first]), ("xyz"[second], np.eye(3)[second])
        across, along = np.linalg.svd(up[None])[2][1:]
        return ("across", across), ("along", along)

    def over_time(self, y_axis: str, values: np.ndarray, names: Sequence[str], bodies: Sequence[str]) -> Panel:
        """A panel of columns (frame_count, len(names))."""
        curves = [
            Curve(name, body, self.times, values[:, column], self.times)
            for column, (name, body) in enumerate(zip(names, bodies, strict=True))
        ]
        return Panel(TIME_AXIS, y_axis, curves)


def pressure(run: RunCurves) -> Panel:
    """Pressures of the cavities."""
    values = run.recording.column("pressure")
    return run.over_time("pressure [kPa]", values, run.recording.cavities, _bodies(run.recording.cavities))


def volume(run: RunCurves) -> Panel:
    """Volumes of the cavities."""
    values = 1e-3 * run.recording.column("volume")
    return run.over_time("volume [cm³]", values, run.recording.cavities, _bodies(run.recording.cavities))


def tension(run: RunCurves) -> Panel:
    """Tensions of the cables at their pulled ends."""
    cables = run.recording.cables
    return run.over_time("tension [mN]", run.recording.column("tension"), cables, _bodies(cables))


def pull(run: RunCurves) -> Panel:
    """How far the cables are pulled in."""
    cables = run.recording.cables
    return run.over_time("pulled in by [mm]", run.recording.column("pull"), cables, _bodies(cables))


def bending(run: RunCurves) -> Panel:
    """Angles by which the tips have turned against the base."""
    time, angles = run.times[run.tips.frames], np.degrees(run.tips.bending_angles)
    curves = [Curve(name, name, time, angles[:, finger], time) for finger, name in enumerate(run.tips.names)]
    return Panel(TIME_AXIS, "bending angle [degrees]", curves)


def stretch(run: RunCurves) -> Panel:
    """Largest principal stretches of the soft bodies, in up to STRETCH_FRAMES frames."""
    frames = np.unique(np.linspace(0, len(run.times) - 1, STRETCH_FRAMES).astype(int))
    laws = [(body, Stretches(body.rest_position, body.elements)) for body in run.recording.soft_bodies]
    rows = [run.recording.row("position", int(frame)) for frame in frames]
    curves = [
        Curve(body.name, body.name, run.times[frames], found, run.times[frames])
        for body, law in laws
        for found in [np.array([law.largest(row[body.nodes]).max() for row in rows])]
    ]
    return Panel(TIME_AXIS, "largest stretch [-]", curves)


def height(run: RunCurves) -> Panel:
    """Heights of objects and base over those at the start."""
    names = _objects(run.recording)
    rises = [_since_start(run, run.recording.column("rigid_position")[:, body]) for body in range(len(names))]
    base = _since_start(run, run.recording.column("base_translation"))
    if not names and not base.any():
        base = np.full_like(base, np.nan)  # nothing rises, so there is nothing to see
    return run.over_time("risen by [mm]", np.column_stack([*rises, base]), [*names, "base"], [*names, ""])


def slip(run: RunCurves) -> Panel:
    """How far objects have slid down the fingers since the moment before the base moves, as in metrics.json."""
    base, names = run.recording.column("base_translation"), _objects(run.recording)
    slide = -run.recording.column("slide") @ run.recording.scene.up
    behind = np.full((len(run.times), len(names)), np.nan)
    for start, end in pieces(run.times):
        rest = last_at_rest(base[start:end])
        if rest is not None:
            before = start + rest
            behind[before:end] = np.cumsum(slide[before:end], axis=0) - slide[before]
    return run.over_time("slip against the fingers [mm]", behind, names, names)


def tips_side(run: RunCurves) -> Panel:
    """Paths of the tips seen from the side."""
    (name, direction), _ = run.sideways
    return _paths(run, name, direction, "height", run.recording.scene.up)


def tips_above(run: RunCurves) -> Panel:
    """Paths of the tips seen from above."""
    (first, along), (second, across) = run.sideways
    return _paths(run, first, along, second, across)


def normal_force(run: RunCurves) -> Panel:
    """Normal forces between bodies that ever touched."""
    return _forces(run, "normal force [mN]", "normal_force")


def friction_force(run: RunCurves) -> Panel:
    """Friction forces between bodies that ever touched."""
    return _forces(run, "friction force [mN]", "friction_force")


def step_time(run: RunCurves) -> Panel:
    """Time that each step took to compute, beside the time that it simulated."""
    values = 1e3 * np.where(run.recording.column("step_time") > 0.0, run.recording.column("step_time"), np.nan)
    every = run.recording.every
    label = "each step" if every == 1 else f"mean of {every} steps"
    curves = [Curve(label, "", run.times, values, run.times)]
    level = (1e3 * run.recording.step_size, "real time")
    return Panel(TIME_AXIS, "time per step [ms]", curves, logarithmic=True, level=level)


def signal(column: int, run: RunCurves) -> Panel:
    """A number of the controller's own, in a unit of its own."""
    name = run.recording.signals[column]
    return run.over_time(f"signal {name}", run.recording.column("signals")[:, [column]], [name], [""])


PANELS: dict[str, Callable[[RunCurves], Panel]] = {
    "pressure": pressure,
    "volume": volume,
    "tension": tension,
    "pull": pull,
    "bending": bending,
    "stretch": stretch,
    "height": height,
    "tips-side": tips_side,
    "tips-above": tips_above,
    "normal-force": normal_force,
    "friction-force": friction_force,
    "slip": slip,
    "step-time": step_time,
}
"""The functions that make the panels, by name."""


def panels_of(recording: Recording) -> dict[str, Callable[[RunCurves], Panel]]:
    """Those of every run, and one for each of the controller's signals, "signal NAME"."""
    return PANELS | {f"signal {name}": partial(signal, column) for column, name in enumerate(recording.signals)}


CABLE_PANELS = ("tension", "pull")
"""Panels that nobody expects of a run without cables."""


def _bodies(names: Sequence[str]) -> list[str]:
    """The bodies of cavities or cables named "body.cavity" and "body.cable"."""
    return [name.split(".")[0] for name in names]


def _objects(recording: Recording) -> list[str]:
    """Names of the rigid bodies."""
    return list(recording.scene.rigid_bodies)


def _since_start(run: RunCurves, position: np.ndarray) -> np.ndarray:
    """Height (frame_count,) above that at the last start; positions of shape (frame_count, 3)."""
    level = position @ run.recording.scene.up
    return np.concatenate([level[start:end] - level[start] for start, end in pieces(run.times)])


def _forces(run: RunCurves, y_axis: str, column: str) -> Panel:
    values = run.recording.column(column)
    touching = [index for index in range(len(run.recording.pairs)) if values[:, index].any()]
    pairs = [run.recording.pairs[index] for index in touching]
    return run.over_time(y_axis, values[:, touching], ["|".join(pair) for pair in pairs], [first for first, _ in pairs])


def _paths(run: RunCurves, x_name: str, x_axis: np.ndarray, y_name: str, y_axis: np.ndarray) -> Panel:
    tips = run.tips
    curves = [
        Curve(
            name, name, tips.positions[:, finger] @ x_axis, tips.positions[:, finger] @ y_axis, run.times[tips.frames]
        )
        for finger, name in enumerate(tips.names)
    ]
    return Panel(f"{x_name} of the tips [mm]", f"{y_name} of the tips [mm]", curves, equal_scales=True)
