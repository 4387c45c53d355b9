"""The output "reduced-check": the full model runs beside the reduced one, and where the two part is said at the end."""

import json
import warnings
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from taichisoft import Model, Output, Simulation, State, StepReport
from taichisoft.base import atomic_file
from taichisoft.errors import SimulationDiverged
from taichisoft_reduction.body_shapes import relative_motions
from taichisoft_reduction.errors import ReductionError
from taichisoft_reduction.training_run import RunFigures
from taichisoft_reduction.validation import POSITION, UNITS, changes, tolerance_share

FILE_NAME = "reduced_check.json"
EVERY = 2
"""Steps from one comparison to the next."""
REQUESTS = (
    *("actuator_imposed", "actuator_request", "valve_request", "frame_request", "frame_velocity"),
    *("anchor_position", "pull_point", "gravity", "young_modulus"),
)
"""Fields of a state that hold the requests of a controller."""


@dataclass(frozen=True)
class Parting:
    """Where a quantity of the reduced model is away from that of the full one.

    Attributes:
        quantity, of, unit: what, of which body or pair, in which unit.
        largest, time: the largest error, and when it was [s].
        mean: of its absolute values.
        scale: largest change of the quantity in the full model, over all bodies.
        parted: time from which on the error was first above the tolerance [s]; None: never.
    """

    quantity: str
    of: str
    unit: str
    largest: float
    time: float
    mean: float
    scale: float
    parted: float | None

    def __str__(self) -> str:
        share = 100.0 * self.largest / self.scale if self.scale else 0.0
        text = f"{self.largest:.2g} {self.unit} ({share:.2g} %) of {self.of} at {self.time:.2f} s"
        return text if self.parted is None else f"{text}; beyond the tolerance from {self.parted:.2f} s on"


class ReducedCheckOutput(Output):
    """Gives the full model what the controller asks of the reduced one, and compares the two."""

    def __init__(self, folder: Path, tolerance: str | None = None):
        """Compare to within a tolerance such as "1%" of the largest change; None: that of the files of modes."""
        self._path = Path(folder) / FILE_NAME
        self._tolerance = None if tolerance is None else tolerance_share("--check-tolerance", tolerance)

    def begin(self, model: Model, state: State) -> None:
        """Make the full model."""
        modes = [body.modes for body in model.soft_bodies if body.modes is not None]
        if not modes:
            raise ReductionError("--reduced-check: no soft body of the scene is reduced; give --reduced FOLDER as well")
        self._within = self._tolerance or max(
            (body_modes.tolerance for body_modes in modes if body_modes.tolerance), default=0.01
        )
        full = {name: body.model_copy(update={"reduced": None}) for name, body in model.scene.soft_bodies.items()}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the reduced model has said the same
            self._full = Simulation(model.scene.model_copy(update={"soft_bodies": full}))
        self._model = model
        self._motions = relative_motions(model, full)
        self.restart(state)

    def restart(self, state: State) -> None:
        """Compare from this state on."""
        self._full.restore(state)
        self._names, self._problem = [body.name for body in self._model.soft_bodies], ""
        self._figures = [RunFigures(self._names, self._model, state) for _ in range(2)]
        self._time: list[float] = []
        self._there: list[dict[str, float]] = []
        self._here: list[dict[str, float]] = []

    def record(self, state: State, report: StepReport) -> None:
        """Make the step with the full model as well."""
        if self._problem:
            return
        full = self._full
        full.restore(full.state.changed(**{name: getattr(state, name) for name in REQUESTS}))
        try:
            other = full.step()
        except SimulationDiverged as error:
            self._problem = f"the full model: {' '.join(str(error).split())}"
            return
        for figures, its_state in zip(self._figures, (full.state, state), strict=True):
            figures.add(its_state)
        if state.step % EVERY == 0:
            self._time.append(state.time)
            there, here = self._figures
            self._there.append(there.at(full.state, other) | self._moved(full.state))
            self._here.append(here.at(state, report) | self._missed(state, full.state))

    def _moved(self, state: State) -> dict[str, float]:
        """The largest displacement of each body relative to the frame that it follows."""
        places, displacements = self._model.places(state), {}
        for body, frame in zip(self._model.soft_bodies, self._model.soft_frame.tolist(), strict=True):
            motion = self._motions[body.name].displacement(state.position[body.nodes], places, frame)
            displacements[f"{POSITION} of {body.name} [mm]"] = float(np.linalg.norm(motion, axis=1).max())
        return displacements

    def _missed(self, here: State, there: State) -> dict[str, float]:
        """The largest error of a position of each body."""
        away = np.linalg.norm(here.position - there.position, axis=1)
        return {f"{POSITION} of {body.name} [mm]": float(away[body.nodes].max()) for body in self._model.soft_bodies}

    def partings(self) -> list[Parting]:
        """A row for each quantity of each body or pair that changes."""
        if not self._time:
            return []
        partings, time = [], np.array(self._time)
        for quantity, unit in UNITS.items():
            names = [name for name in self._there[0] if name.startswith(f"{quantity} of ")]
            if not names:
                continue
            there, here = (np.array([[row[n] for row in run] for n in names]) for run in (self._there, self._here))
            scale = float(changes(quantity, there).max(initial=0.0))
            if not scale > 0.0:
                continue
            error = here if quantity == POSITION else np.abs(here - there)
            for name, row in zip(names, error, strict=True):
                worst, beyond = int(row.argmax()), np.flatnonzero(row > self._within * scale)
                of = name.removeprefix(f"{quantity} of ").rpartition(" [")[0]
                parted = float(time[beyond[0]]) if len(beyond) else None
                largest = float(row[worst])
                partings.append(
                    Parting(quantity, of, unit, largest, float(time[worst]), float(row.mean()), scale, parted)
                )
        return partings

    def end(self, outcome: str) -> None:
        """Write reduced_check.json."""
        rows = [asdict(parting) for parting in self.partings()]
        tables = {"tolerance": self._within, "problem": self._problem, "quantities": rows}
        with atomic_file(self._path, ReductionError) as partial:
            partial.write_text(json.dumps(tables, indent=2) + "\n", encoding="utf-8")

    def summary(self) -> dict[str, str]:
        """The worst row of each quantity."""
        if not hasattr(self, "_within"):
            return {}
        rows: dict[str, str] = {}
        for quantity in UNITS:
            own = [parting for parting in self.partings() if parting.quantity == quantity]
            if own:
                rows[f"{quantity}: reduced from full"] = str(max(own, key=lambda parting: parting.largest))
        if self._problem:
            rows["reduced from full: compared until"] = self._problem
        return rows
