"""The gradient of a study's run: states are kept while it runs, and its objective is then taken back to the keys."""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft import Control, Controller, Observation, Simulation, gradient
from taichisoft.base import read_arrays
from taichisoft.errors import ControllerFailed
from taichisoft.mesh import tetrahedron_volumes
from taichisoft_studies.curve_differences import Compared, CurveDifferences
from taichisoft_studies.study_file import Expression

if TYPE_CHECKING:
    from taichisoft import Scene, StepReport
    from taichisoft.contact import Model

MEMORY = 2e8
"""States are kept up to so much [B]; later ones are made again."""
WIDTH = 1e-6
"""Half width of differences of expressions, over a parameter, and over other values or 1 where that is more [-]."""
WITHOUT_SLOPE = ("time", "step")
PARAMETERS, VOLUMES = "parameters", "rest_volumes_mm3"


class KeptSimulation(Simulation):
    """A simulation that keeps its states, and looks up the steps that it has made when it starts again.

    Attributes:
        start: the first state.
        controls: what each step was asked for.
    """

    def __init__(self, scene: "Scene"):
        super().__init__(scene)
        self.start, self.controls = self.state, list[Control]()
        self._states, self._bytes = [self.state], 0

    def step(self, control: Control | None = None) -> "StepReport":
        """See `Simulation`."""
        number = self.state.step - self.start.step
        if number + 1 < len(self._states) and self.report is not None:
            self.state = self._states[number + 1]
            return self.report
        report = super().step(control)
        if number == len(self.controls):
            self.controls.append(control or Control())
        self._bytes += sum(value.nbytes for value in vars(self.state).values() if isinstance(value, np.ndarray))
        if number + 1 == len(self._states) and self._bytes < MEMORY:
            self._states.append(self.state)
        return report


class OpenLoop(Controller):
    """A controller, and one like it that is shown the first observation at all times.

    Where they differ, what is asked for depends on the run, which derivatives leave out.
    """

    def __init__(self, controller: Controller, blind: Controller):
        self._controller, self._blind = controller, blind
        self._first: Observation | None = None

    def reset(self, model: "Model") -> None:
        """See `Controller`."""
        self._first = None
        self._controller.reset(model)
        self._blind.reset(model)

    def control(self, observation: Observation) -> Control:
        """See `Controller`; raises ControllerFailed."""
        self._first = first = self._first or observation
        control = self._controller.control(observation)
        seen = replace(first, time=observation.time, step=observation.step)
        if _as_text(control) != _as_text(self._blind.control(seen)):
            raise ControllerFailed(
                f"at {observation.time:g} s the controller heeds what it sees; a gradient needs one that depends on "
                "time alone, such as a script of keyframes"
            )
        return control


def _as_text(control: Control) -> str:
    return json.dumps(
        vars(control), default=lambda value: value.tolist() if isinstance(value, np.ndarray) else vars(value)
    )


def derived(
    simulation: KeptSimulation,
    request: Mapping[str, Any],
    watch: Mapping[str, str],
    columns: Mapping[str, np.ndarray],
    named: Mapping[str, Any],
    observed: Callable[[Observation], Mapping[str, Any]],
) -> dict[str, Any]:
    """The derivatives of the objective of a run by keys of a study, and how exact they are, as metrics.

    Args:
        simulation: at the end of the run.
        request: "factors", of the derivatives by names of `taichisoft.gradient`, by key of the study; "moves", files
            of the moves of a mesh by body, by key; and "squares" (`Compared`) or "objective", an expression of metrics,
            with "figures": the field of an observation behind each metric, and the factor of its unit.
        watch: expressions of the curves.
        columns: their values after each step, shape (step_count,).
        named: names in an expression of metrics.
        observed: gives the names in an expression of an observation.
    """
    start, keys = simulation.start.step + 1, [*request["factors"], *request["moves"]]
    moves = {key: _mesh_moves(simulation.model, files) for key, files in request["moves"].items()}
    own = dict.fromkeys(keys, 0.0)
    slopes: list[dict[str, Any]] = [{} for _ in simulation.controls]
    weights: Mapping[str, np.ndarray] = {}
    if "squares" in request:
        weights = CurveDifferences(columns, Compared(**request["squares"])).slopes()
    else:
        for name, key, slope in differences(Expression(request["objective"], "objective"), named):
            if name == PARAMETERS and key in own:
                own[key] += float(slope)
            elif name == VOLUMES:
                for moved, by_body in moves.items():
                    own[moved] += float(slope) * by_body[key][1] if key in by_body else 0.0
            elif name in request["figures"]:
                field, factor = request["figures"][name]
                slopes[-1][f"{field}.{key}"] = factor * slope
    expressions = {name: Expression(watch[name], name) for name in weights}

    def objective(seen: Observation) -> tuple[float, Mapping[str, Any]]:
        parts = slopes[seen.step - start]
        for name, expression in expressions.items():
            if weight := weights[name][seen.step - start]:
                for field, key, slope in differences(expression, observed(seen)):
                    figure = f"{field}.{key}".rstrip(".")
                    parts[figure] = parts.get(figure, 0.0) + weight * slope
        return 0.0, parts

    by = dict.fromkeys(name for factors in request["factors"].values() for name in factors)
    nodes = {key: np.zeros((simulation.model.node_count, 3)) for key in moves}
    for key, by_body in moves.items():
        for body in simulation.model.soft_bodies:
            if body.name in by_body:
                nodes[key][body.nodes] = by_body[body.name][0]
    simulation.restore(simulation.start)
    found = gradient(simulation, simulation.controls, objective, [*by, *(f"rest.{key}" for key in moves)], nodes)
    for key, factors in request["factors"].items():
        own[key] += sum(factor * float(found[name]) for name, factor in factors.items())
    for key in moves:
        own[key] += float(found[f"rest.{key}"])
    shares = {name: getattr(found, name) for name in ("edge_share", "inexact_share", "shifted_share")}
    return {"gradient": own, **{f"gradient_{name}": share for name, share in shares.items()}}


def differences(expression: Expression, names: Mapping[str, Any]) -> Iterator[tuple[str, str, np.ndarray]]:
    """Derivatives of an expression by all numbers behind the names in it: name, key in a table, and those by its value.

    They are differences over `WIDTH`, exact but for round-off where the expression is linear.
    """
    for name in sorted(expression.names & names.keys() - set(WITHOUT_SLOPE)):
        is_table = isinstance(names[name], Mapping)
        for key, given in names[name].items() if is_table else [("", names[name])]:
            if isinstance(given, str) or given is None:
                continue
            value, slope = np.array(given, dtype=float), np.zeros(np.shape(given))
            for index in np.ndindex(value.shape):
                size = abs(float(value[index]))
                half = WIDTH * (size if name == PARAMETERS and size else max(1.0, size))  # densities are of 1e-6
                sides = []
                for sign in (half, -half):
                    moved = value.copy()
                    moved[index] += sign
                    sides.append(expression({**names, name: {**names[name], key: moved} if is_table else moved}))
                slope[index] = (sides[0] - sides[1]) / (2.0 * half)
            if slope.any():
                yield name, key, slope


def _mesh_moves(model: "Model", files: Mapping[str, str]) -> dict[str, tuple[np.ndarray, float]]:
    """By body, how a key moves its nodes in space [mm per unit], and how it changes its volume [mm^3 per unit]."""
    moves = {}
    for body in model.soft_bodies:
        if body.name in files:
            move, nodes = read_arrays(files[body.name])["move"], body.mesh.nodes
            half = 1e-3 / max(float(np.abs(move).max()), 1e-300)  # [mm]
            more, less = (tetrahedron_volumes(nodes + sign * half * move, body.mesh.elements) for sign in (1.0, -1.0))
            turn = np.linalg.lstsq(nodes - nodes.mean(axis=0), body.rest_position - body.rest_position.mean(axis=0))[0]
            moves[body.name] = move @ turn, float((more - less).sum() / (2.0 * half))
    return moves
