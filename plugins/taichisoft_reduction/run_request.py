"""A run of the training or the validation as plain data, and what came out of it."""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import taichisoft
from taichisoft.base import read_arrays
from taichisoft.mechanics import ACTUATOR_KINDS, UNLIMITED, Drive
from taichisoft_reduction.body_shapes import BodyShape
from taichisoft_reduction.errors import ReductionError

if TYPE_CHECKING:
    from taichisoft import Model

DIGITS = 12
"""Digits of the hash in a file's name."""


@dataclass(frozen=True)
class Timetable:
    """What is asked for over time, linear between the times.

    Attributes:
        times: [s], rising, shape (count,).
        channels: values at these times by "KEY/NAME", such as "pressure/finger.cavity" [kPa] or "base_rotation/x"
            [rad], with a key of `taichisoft.Control` and the name of an actuator or of an axis.
    """

    times: tuple[float, ...]
    channels: Mapping[str, tuple[float, ...]]

    @property
    def duration(self) -> float:
        """Time of the last entry [s]."""
        return self.times[-1]


@dataclass(frozen=True)
class TrainingRun:
    """A run to be made.

    Attributes:
        name: short name in files, tables and messages.
        scene: resolved scene as TOML.
        bodies: names of the soft bodies whose displacements are kept.
        duration: simulated time [s].
        timetable: what drives it; None for the scene's own controller.
        factor: factor on all pressures, volumes, tensions and pulls that the scene's own controller asks for.
        frames: number of moments that are kept.
        plugins: paths of the plug-ins that it needs.
        files: digest of the meshes that the scene names.
    """

    name: str
    scene: str
    bodies: tuple[str, ...]
    duration: float
    timetable: Timetable | None = None
    factor: float = 1.0
    frames: int = 24
    plugins: tuple[str, ...] = ()
    files: str = ""

    @property
    def file_name(self) -> str:
        """Name of its file, which has a hash of all that decides what comes out."""
        text = json.dumps({**asdict(self), "version": taichisoft.__version__}, sort_keys=True)
        return f"{self.name}-{hashlib.sha256(text.encode()).hexdigest()[:DIGITS]}.npz"


@dataclass(frozen=True)
class RunResult:
    """What came out of a run.

    Attributes:
        name: name of the run.
        problem: why it did not reach its end, in one line; empty where it did.
        time: of each frame [s], shape (frame_count,).
        displacement: relative displacements of the nodes by body [mm], shape (frame_count, node_count, 3).
        figures: values in each frame by name with unit, such as "lift of cube [mm]", shape (frame_count,).
        touched: whether something pressed a node, by body, shape (node_count,).
        drives: by actuator, the key of `taichisoft.Control` that drove it, and its smallest and largest value.
        steps_per_second: of processor time, without the time for what is kept.
    """

    name: str
    problem: str
    time: np.ndarray
    displacement: Mapping[str, np.ndarray]
    figures: Mapping[str, np.ndarray]
    touched: Mapping[str, np.ndarray] = field(default_factory=dict)
    drives: Mapping[str, tuple[str, float, float]] = field(default_factory=dict)
    steps_per_second: float = 0.0

    def save(self, path: Path) -> None:
        """Write it to a file of numpy's."""
        about = {
            "name": self.name,
            "problem": self.problem,
            "figures": list(self.figures),
            "drives": dict(self.drives),
            "steps_per_second": self.steps_per_second,
        }
        values = np.column_stack([np.zeros((len(self.time), 0)), *self.figures.values()])
        arrays: dict[str, Any] = {f"displacement/{name}": one for name, one in self.displacement.items()}
        arrays |= {f"touched/{name}": one for name, one in self.touched.items()}
        with path.open("wb") as file:
            np.savez(file, about=np.array(json.dumps(about)), time=self.time, figures=values, **arrays)

    @classmethod
    def load(cls, path: Path) -> "RunResult | None":
        """Read what `save` wrote; None where there is nothing, or not all of it."""
        try:
            file = read_arrays(path)
            about = json.loads(str(file["about"]))
            parts = {name.partition("/")[::2]: one for name, one in file.items() if "/" in name}
            return cls(
                name=about["name"],
                problem=about["problem"],
                time=file["time"],
                displacement={body: one for (kind, body), one in parts.items() if kind == "displacement"},
                figures=dict(zip(about["figures"], file["figures"].T, strict=True)),
                touched={body: one for (kind, body), one in parts.items() if kind == "touched"},
                drives={name: (key, low, high) for name, (key, low, high) in about["drives"].items()},
                steps_per_second=about["steps_per_second"],
            )
        except (OSError, ValueError, KeyError):
            return None


# How far the actuators of a body are driven in the training.

BEYOND = 1.25
"""The training goes so far beyond what the scene's own run asks for."""

Ranges = Mapping[str, tuple[str, float, float]]
"""Key of `taichisoft.Control`, smallest and largest value of each actuator of the first body of a shape, by name."""


def actuator_ranges(
    model: "Model", shape: BodyShape, own_run: RunResult | None, asked: Mapping[str, tuple[float, float]], full: bool
) -> Ranges:
    """The ranges of the first body's actuators, over all copies.

    Args:
        model: model of the scene.
        shape: the body and its copies.
        own_run: what the scene's own controller asks for; None without one.
        asked: ranges that the user gives, by "body.actuator".
        full: whether to go to the scene's limits, and not only somewhat beyond the own run.

    Raises:
        ReductionError: neither the own run, nor a limit, nor the user says how far to go.
    """
    found = {}
    for kind in ACTUATOR_KINDS:
        for name in model.actuators.names_of(kind):
            if name.partition(".")[0] == shape.name:
                copies = [f"{body}.{name.partition('.')[2]}" for body in shape.bodies]
                found[name] = _range(model, copies, own_run, asked, full, (kind.effort, kind.coordinate))
    return found


def _range(
    model: "Model",
    copies: Sequence[str],
    own_run: RunResult | None,
    asked: Mapping[str, tuple[float, float]],
    full: bool,
    drives: tuple[Drive, Drive],
) -> tuple[str, float, float]:
    used = [own_run.drives[name] for name in copies if own_run is not None and name in own_run.drives]
    by_coordinate = any(key == drives[1].asked for key, _, _ in used)
    drive = drives[by_coordinate]
    for name in copies:
        if name in asked:
            return drive.asked, *asked[name]
    low, high = min((one for _, one, _ in used), default=0.0), max((one for _, _, one in used), default=0.0)
    limit_low, limit_high = _limits(model, copies[0], drive, by_coordinate)
    if (full or low == high) and math.isfinite(limit_high):
        return drive.asked, min(0.0, limit_low) if math.isfinite(limit_low) else 0.0, limit_high
    if low == high:
        raise ReductionError(
            f"--range {copies[0]}=LOW:HIGH: needed, since neither the scene's own run drives '{copies[0]}' nor a limit "
            f"ends its {drive.words} [{drive.unit}]"
        )
    return drive.asked, max(BEYOND * low, limit_low), min(BEYOND * high, limit_high)


def _limits(model: "Model", name: str, drive: Drive, by_coordinate: bool) -> tuple[float, float]:
    """Smallest and largest value that the actuator and the scene's limits allow; infinite where none is set."""
    number = model.actuators.names.index(name)
    ranges = model.actuators.coordinate_range if by_coordinate else model.actuators.effort_range
    low, high = (float(one) for one in ranges[number])
    limits = model.scene.limits
    scene_low, scene_high = (
        getattr(limits, f"lowest_{drive.name}", None),
        getattr(limits, f"highest_{drive.name}", None),
    )
    low = max(low, -np.inf if scene_low is None else scene_low)
    high = min(high, np.inf if scene_high is None else scene_high)
    return low if low > -UNLIMITED else -math.inf, high if high < UNLIMITED else math.inf
