"""A run of the training or the validation as plain data, and what came out of it."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import taichisoft
from taichisoft.input_file import read_arrays

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
