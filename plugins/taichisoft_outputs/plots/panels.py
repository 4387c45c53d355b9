"""The curves of a run: one small panel for each quantity, made from the recording's columns."""

from collections.abc import Callable, Sequence
from functools import cached_property, partial

import numpy as np

from taichisoft.actuators import ACTUATOR_KINDS, ActuatorFigure, ActuatorKind, StateFigure
from taichisoft.bodies import Stretches
from taichisoft_outputs.base_motion import last_at_rest
from taichisoft_outputs.plots.figure import Panel, PlotCurve, pieces
from taichisoft_outputs.recorded_tips import recorded_fingertips, tip_state
from taichisoft_outputs.recording.reader import Recording

TIME_AXIS = "time [s]"
STRETCH_FRAMES = 100
"""Most frames of a long run whose elements are looked at, evenly spaced."""
TIP_FRAMES = 600
"""Most frames of a long run whose fingertips are looked at, evenly spaced: each takes reading all positions."""


class RunCurves:
    """Makes the panels of a recording.

    Attributes:
        recording: the recording, which stays open.
        times: times of its frames [s], shape (frame_count,).
        objects: names of the rigid bodies that no frame carries.
        object_columns: their numbers among all rigid bodies.
    """

    def __init__(self, recording: Recording):
        """Prepare; tips are read when a panel needs them."""
        self.recording = recording
        self.times = recording.times
        self.objects = recording.scene.objects
        self.object_columns = [list(recording.scene.rigid_bodies).index(name) for name in self.objects]

    @cached_property
    def tips(self) -> tuple[Sequence[str], np.ndarray, np.ndarray, np.ndarray]:
        """Tips of the fingers in up to TIP_FRAMES frames, as a controller would have observed them.

        Names of the fingers, and of shape (count, ...): times [s], positions [mm] of each finger, bending angles [rad].
        """
        observer = recorded_fingertips(self.recording, self.recording.soft_bodies)
        frames = _evenly_spaced(self.times, TIP_FRAMES)
        observed = [observer.observe(tip_state(self.recording, frame)) for frame in frames]
        positions, _, bending_angles = (np.array(values) for values in zip(*observed, strict=True))
        return observer.names, self.times[frames], positions, bending_angles

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
        """A panel of columns (frame_count, len(names)); a recording without such bodies may have an empty one more."""
        curves = [
            PlotCurve(name, body, self.times, values[:, column], self.times)
            for column, (name, body) in enumerate(zip(names, bodies, strict=True))
        ]
        return Panel(TIME_AXIS, y_axis, curves)


def _actuators(kind: ActuatorKind, figure: ActuatorFigure, run: RunCurves) -> Panel:
    """A figure of all actuators of a kind, such as the pressures of the cavities."""
    names = run.recording.actuators.names_of(kind)
    values = figure.plot_factor * run.recording.column(figure.name)
    return run.over_time(figure.plotted, values, names, [name.partition(".")[0] for name in names])


def bending(run: RunCurves) -> Panel:
    """Angles by which the tips have turned against the base."""
    names, times, _, angles = run.tips
    curves = [
        PlotCurve(name, name, times, of_tip, times) for name, of_tip in zip(names, np.degrees(angles).T, strict=True)
    ]
    return Panel(TIME_AXIS, "bending angle [degrees]", curves)


def _tip(axis: int, run: RunCurves) -> Panel:
    """A coordinate of the tips in the world."""
    names, times, positions, _ = run.tips
    curves = [
        PlotCurve(name, name, times, of_tip, times) for name, of_tip in zip(names, positions[..., axis].T, strict=True)
    ]
    return Panel(TIME_AXIS, f"{'xyz'[axis]} of the tip [mm]", curves)


def against(x: Panel, y: Panel) -> Panel:
    """One panel over time against another: each curve over that of the same body, or over the only one.

    Args:
        x, y: panels over time; where they have different times, x is interpolated.
    """
    curves = []
    for curve in y.curves:
        own = [one for one in x.curves if one.body == curve.body] or (x.curves if len(x.curves) == 1 else [])
        for one in own:
            over = one.y
            if not np.array_equal(one.time, curve.time):
                over = np.interp(_clock(curve.time), _clock(one.time), one.y)
            label = curve.label if len(own) == 1 else f"{curve.label} over {one.label}"
            curves.append(PlotCurve(label, curve.body, over, curve.y, curve.time))
    return Panel(x.y_axis, y.y_axis, curves)


def _clock(time: np.ndarray) -> np.ndarray:
    """Times [s] that go on over new starts, so that they only rise."""
    return np.concatenate([[0.0], np.cumsum(np.where(np.diff(time) < 0.0, 1e-9, np.diff(time)))])


def stretch(run: RunCurves) -> Panel:
    """Largest principal stretches of the soft bodies, in up to STRETCH_FRAMES frames."""
    frames = _evenly_spaced(run.times, STRETCH_FRAMES)
    rows = [run.recording.row("position", int(frame)) for frame in frames]
    curves = []
    for body in run.recording.soft_bodies:
        stretches = Stretches(body.rest_position, body.elements)
        largest = np.array([stretches.largest(row[body.nodes]).max() for row in rows])
        curves.append(PlotCurve(body.name, body.name, run.times[frames], largest, run.times[frames]))
    return Panel(TIME_AXIS, "largest stretch [-]", curves)


def height(run: RunCurves) -> Panel:
    """Heights of objects and base over their heights at the start."""
    names, up = run.objects, run.recording.scene.up
    levels = run.recording.column("rigid_position") @ up
    rises = [_since_start(run, levels[:, body]) for body in run.object_columns]
    base = _since_start(run, run.recording.base_translation @ up)
    if not names and not base.any():
        base = np.full_like(base, np.nan)  # nothing rises, so there is nothing to see
    return run.over_time("risen by [mm]", np.column_stack([*rises, base]), [*names, "base"], [*names, ""])


def slip(run: RunCurves) -> Panel:
    """How far objects have slid down the fingers since the moment before the base moves, as in metrics.json."""
    base, names = run.recording.base_translation, run.objects
    slide = (-run.recording.column("slide") @ run.recording.scene.up)[:, run.object_columns]
    behind = np.full((len(run.times), len(names)), np.nan)
    for start, end in pieces(run.times):
        rest = last_at_rest(base[start:end])
        if rest is not None:
            before = start + rest
            behind[before:end] = np.cumsum(slide[before:end], axis=0) - slide[before]
    return run.over_time("slip against the fingers [mm]", behind, names, names)


def _tips_side(run: RunCurves) -> Panel:
    (name, direction), _ = run.sideways
    return _paths(run, name, direction, "height", run.recording.scene.up)


def _tips_above(run: RunCurves) -> Panel:
    (first, along), (second, across) = run.sideways
    return _paths(run, first, along, second, across)


def _forces(column: str, y_axis: str, run: RunCurves) -> Panel:
    """Forces between the bodies that ever touched."""
    values = run.recording.column(column)
    touching = np.flatnonzero(values.any(axis=0))
    pairs = [run.recording.pairs[index] for index in touching]
    return run.over_time(y_axis, values[:, touching], ["|".join(pair) for pair in pairs], [first for first, _ in pairs])


def _wrench(row: int, y_axis: str, run: RunCurves) -> Panel:
    """Components of the force on the base, or of the torque, in world axes."""
    return run.over_time(y_axis, run.recording.column("frame_wrench")[:, 0, row], ["x", "y", "z"], ["", "", ""])


def frame_force(run: RunCurves) -> Panel:
    """Amounts of the forces on the frames beside the base."""
    names = run.recording.frames.names[1:]
    forces = np.linalg.norm(run.recording.column("frame_wrench")[:, 1:, 0], axis=2)
    return run.over_time("force on a frame [mN]", forces, names, [""] * len(names))


def step_time(run: RunCurves) -> Panel:
    """Time that each step took to compute, beside the time that it simulated."""
    values = 1e3 * np.where(run.recording.column("step_time") > 0.0, run.recording.column("step_time"), np.nan)
    every = run.recording.every
    label = "each step" if every == 1 else f"mean of {every} steps"
    curves = [PlotCurve(label, "", run.times, values, run.times)]
    level = (1e3 * run.recording.step_size, "real time")
    return Panel(TIME_AXIS, "time per step [ms]", curves, logarithmic=True, level=level)


def _signal(column: int, run: RunCurves) -> Panel:
    """A signal of the controller, in its own unit."""
    name = run.recording.signals[column]
    return run.over_time(f"signal {name}", run.recording.column("signals")[:, [column]], [name], [""])


PANELS: dict[str, Callable[[RunCurves], Panel]] = {
    **{
        figure.name: partial(_actuators, kind, figure)
        for kind in ACTUATOR_KINDS
        for figure in kind.measured
        if figure.plotted
    },
    "bending": bending,
    "tip-x": partial(_tip, 0),
    "tip-y": partial(_tip, 1),
    "tip-z": partial(_tip, 2),
    "stretch": stretch,
    "height": height,
    "tips-side": _tips_side,
    "tips-above": _tips_above,
    "normal-force": partial(_forces, "normal_force", "normal force [mN]"),
    "friction-force": partial(_forces, "friction_force", "friction force [mN]"),
    "contact-area": partial(_forces, "contact_area", "area in contact [mm²]"),
    "contact-pressure": partial(_forces, "peak_pressure", "highest contact pressure [kPa]"),
    "slip": slip,
    "base-force": partial(_wrench, 0, "force on the base [mN]"),
    "base-torque": partial(_wrench, 1, "torque on the base [mN mm]"),
    "frame-force": frame_force,
    "step-time": step_time,
}
"""The functions that make the panels, by name."""


def panels_of(recording: Recording) -> dict[str, Callable[[RunCurves], Panel]]:
    """PANELS, and a panel "signal NAME" for each signal of the controller."""
    return PANELS | {f"signal {name}": partial(_signal, column) for column, name in enumerate(recording.signals)}


def expected(name: str, recording: Recording) -> bool:
    """Whether somebody expects a panel: that of cables or frames only where there are some, of air with its own law.

    Coordinates of tips are there for other axes than time; two panels show the paths.
    """
    if name in ("tip-x", "tip-y", "tip-z"):
        return False
    for kind in ACTUATOR_KINDS:
        tables = recording.scene.actuators(kind.plural).values()
        for figure in kind.measured:
            if figure.name == name:
                matters = figure.matters if isinstance(figure, StateFigure) else bool
                return (kind.always_driven and figure not in kind.figures) or any(map(matters, tables))
    return name != "frame-force" or bool(recording.scene.frames)


def _evenly_spaced(times: np.ndarray, count: int) -> np.ndarray:
    """Indices of at most `count` frames from the first to the last."""
    return np.unique(np.linspace(0, len(times) - 1, count).astype(int))


def _since_start(run: RunCurves, level: np.ndarray) -> np.ndarray:
    """Heights (frame_count,) above that at the last start."""
    return np.concatenate([level[start:end] - level[start] for start, end in pieces(run.times)])


def _paths(run: RunCurves, x_name: str, x_axis: np.ndarray, y_name: str, y_axis: np.ndarray) -> Panel:
    names, times, positions, _ = run.tips
    curves = [
        PlotCurve(name, name, path @ x_axis, path @ y_axis, times)
        for name, path in zip(names, positions.swapaxes(0, 1), strict=True)
    ]
    return Panel(f"{x_name} of the tips [mm]", f"{y_name} of the tips [mm]", curves, equal_scales=True)
