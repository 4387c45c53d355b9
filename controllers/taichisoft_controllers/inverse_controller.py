"""The controller "inverse": follows a path by the pressures, pulls and poses under which soft bodies rest on it."""

from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, Self

import numpy as np
from pydantic import Field, model_validator

import taichisoft
from taichisoft.control import Control, Controller, Observation, find_figure
from taichisoft.errors import ControllerFailed, SceneError, TaichisoftError
from taichisoft.scene import Positive
from taichisoft.step import asking
from taichisoft_controllers.model_names import fingers_called
from taichisoft_controllers.settings import ControllerSettings

if TYPE_CHECKING:
    from taichisoft.contact import Model

SETTINGS = "controller.settings"


class InverseSettings(ControllerSettings):
    """Settings of the controller "inverse"."""

    path: Annotated[list[list[float]], Field(min_length=1)]
    """Rows of a time [s] and the value then, between which it is interpolated: [[0.0, x, y, z], ...] for a tip."""
    bounds: Annotated[dict[str, list[float]], Field(min_length=1)]
    """Lowest and highest value of each control that may change, such as {"pressure.finger.cavity" = [0.0, 30.0]}."""
    figure: str = ""
    """What follows the path, by the name of a figure of rollouts; the tip of the only finger when none is given."""
    relative: bool = False
    """Whether the path is the difference from the value at rest, under what is asked for at the start."""
    spacing: Positive = 0.1
    """Longest time between places of the path for which controls are found; between them they are interpolated [s]."""
    tolerance: Positive = 0.1
    """How far off the path a place may stay; the run fails where it cannot come nearer [mm, rad, mN]."""

    @model_validator(mode="after")
    def _check_path(self) -> Self:
        if len({len(row) for row in self.path}) > 1 or len(self.path[0]) < 2:
            raise ValueError("path: each row must be a time and a value, all of the same length")
        if any(after[0] <= before[0] for before, after in pairwise(self.path)):
            raise ValueError("path: times must rise from row to row")
        return self


class InverseController(Controller):
    """Finds the controls of places on the path before the run, each from the one before, and interpolates.

    It does not look where the bodies are: on a fast path they lag by what inertia and damping take.
    """

    def __init__(self, **settings: Any):
        """Take the settings that `InverseSettings` describes."""
        self._settings = InverseSettings.checked(**settings)

    def reset(self, model: "Model") -> None:
        """Find the controls of the path."""
        settings, simulation = self._settings, taichisoft.Simulation(model)
        name = settings.figure or _only_tip(model)
        self._names = tuple(settings.bounds)
        try:
            rest = taichisoft.equilibrium(simulation)
            simulation.restore(rest.state)
            at_rest = find_figure(name, rest.observation, model.body_names).of(rest.observation)
            times, path = np.array([row[0] for row in settings.path]), np.array([row[1:] for row in settings.path])
            if at_rest.size != path.shape[1]:
                raise SceneError(f"path: must have {at_rest.size + 1} numbers in a row, a time and {name}")
            path = path + (at_rest.ravel() if settings.relative else 0.0)
            self._times = _places(times, settings.spacing)
            places = np.column_stack([np.interp(self._times, times, column) for column in path.T])
            self._values = np.array([self._reach(simulation, name, place.reshape(at_rest.shape)) for place in places])
        except ControllerFailed:
            raise
        except TaichisoftError as error:
            raise SceneError(f"{SETTINGS}: {error}") from error
        finally:
            simulation.close()

    def control(self, observation: Observation) -> Control:
        """What the path asks for at the end of the coming steps."""
        time = observation.time + observation.control_period
        values = [float(np.interp(time, self._times, column)) for column in self._values.T]
        assert observation.state is not None, "an observation of a simulation has its state"
        return asking(observation.state, dict(zip(self._names, values, strict=True)))

    def save(self) -> dict[str, Any]:
        """Nothing: the time says it all."""
        return {}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on by the time."""

    def base_stops_at(self, observation: Observation) -> float:
        """The end of the path."""
        return max(observation.time, float(self._times[-1]))

    def _reach(self, simulation: taichisoft.Simulation, name: str, place: np.ndarray) -> list[float]:
        """The controls of a place; the simulation goes there."""
        settings = self._settings
        bounds = {key: (ends[0], ends[-1]) for key, ends in settings.bounds.items()}
        solution = taichisoft.inverse(simulation, {name: place}, bounds)
        if np.abs(solution.residuals[name]).max() > settings.tolerance:
            where = ", ".join(f"{value:.4g}" for value in place.ravel())
            raise ControllerFailed(f"{SETTINGS}.path: {name} cannot be at ({where}): {solution.message}")
        simulation.restore(solution.equilibrium.state)
        return list(solution.values.values())


def _only_tip(model: "Model") -> str:
    fingers = fingers_called(None, model)
    if len(fingers) > 1:
        raise SceneError(f'{SETTINGS}.figure: which of {len(fingers)} fingers? such as "tip_positions.{fingers[0]}"')
    return f"tip_positions.{fingers[0]}"


def _places(times: np.ndarray, spacing: float) -> np.ndarray:
    """The times of a path, and others between them, so that none are farther apart."""
    between = [np.linspace(a, b, max(2, int(np.ceil((b - a) / spacing)) + 1))[1:] for a, b in pairwise(times)]
    return np.concatenate([times[:1], *between])
