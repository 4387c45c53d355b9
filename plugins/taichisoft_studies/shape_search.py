"""Optimisation along gradients: how dimensions of a geometry move the nodes of its mesh, and the descent of trials."""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import spsolve
from scipy.spatial import cKDTree

from taichisoft import Scene, VolumeMesh, write_volume_mesh
from taichisoft.base import atomic_file
from taichisoft.control import FIGURES, In
from taichisoft.errors import MeshError, nearest
from taichisoft.mesh import boundary_triangles, joined_pieces
from taichisoft.running import FigureSlopes
from taichisoft_meshing.closed_shells import angles_between, area_vectors, facing_sides
from taichisoft_meshing.geometry_file import is_geometry
from taichisoft_meshing.mesh_job import mesh_for_scene
from taichisoft_studies.errors import StudyError
from taichisoft_studies.gradient_search import Enough, descend, factors, rate_of, share_of, value_at
from taichisoft_studies.kept_run import VOLUMES
from taichisoft_studies.optimiser import PARAMETERS, Optimisation, counted
from taichisoft_studies.run_job import read_record
from taichisoft_studies.study_file import Expression, Range, is_of_scene, scene_with
from taichisoft_studies.sweep_runs import RUNS, fixed_overrides, job_for
from taichisoft_studies.trials import RUNS_OF_TRIAL, TrialRuns, run_trials
from taichisoft_studies.workers import Workers

# Moves of the nodes of a mesh with a dimension: its flat faces go where they are in meshes of a little more and less.

FLAT = 1e-6
"""Largest angle between triangles of one face [rad]."""
HELD = 1e8
"""Weight of the places of faces over the evenness of the moves of neighbours [-]."""
MISSED = 1e-3
"""Largest distance of a node from its faces, over the largest move [-]."""


class Faces:
    """The flat faces of a mesh's surface.

    Attributes:
        nodes, faces: every node of each face, as pairs, (pair_count,).
        normal, middle: of each face, outward [-] and [mm], shape (face_count, 3).
    """

    def __init__(self, mesh: VolumeMesh):
        """Join the triangles of the surface that continue each other."""
        triangles = boundary_triangles(mesh.elements)
        areas = area_vectors(mesh.nodes[triangles])
        size = np.linalg.norm(areas, axis=1)
        pairs = facing_sides(triangles) // 3
        face = joined_pieces(len(triangles), pairs[angles_between(areas / size[:, None], pairs) < FLAT])
        pairs = np.unique(np.column_stack([np.repeat(face, 3), triangles.ravel()]), axis=0)
        self.faces, self.nodes = pairs.T
        sums = sparse.csr_array((np.ones(len(face)), (face, np.arange(len(face)))))
        normal = sums @ areas
        self.normal = normal / np.linalg.norm(normal, axis=1)[:, None]
        self.middle = (sums @ (size[:, None] * mesh.nodes[triangles].mean(axis=1))) / (sums @ size)[:, None]


def moves_of_nodes(mesh: VolumeMesh, more: VolumeMesh, less: VolumeMesh, half: float) -> np.ndarray:
    """Moves of the nodes of a mesh with a dimension [mm per unit], shape (node_count, 3).

    Nodes on faces follow these, and slide along them; neighbours move alike.

    Args:
        mesh: of linear tetrahedra.
        more, less: the body with the dimension `half` larger and smaller, however they are meshed.
        half: the change of the dimension.

    Raises:
        StudyError: faces come, go, or cannot be told apart, or none moves.
    """
    own = Faces(mesh)
    size = float(np.ptp(mesh.nodes, axis=0).max())
    distance = np.zeros((2, len(own.nodes)))
    for side, other in enumerate(map(Faces, (more, less))):
        tree = cKDTree(np.hstack([other.middle, size * other.normal]))
        match = tree.query(np.hstack([own.middle, size * own.normal]))[1]
        if len(other.middle) != len(own.middle) or len(np.unique(match)) != len(match):
            raise StudyError(f"its surface changes from {len(own.middle)} to {len(other.middle)} flat faces")
        normal, middle = other.normal[match][own.faces], other.middle[match][own.faces]
        distance[side] = ((middle - mesh.nodes[own.nodes]) * normal).sum(axis=1)
    wanted, normal = (distance[0] - distance[1]) / (2.0 * half), own.normal[own.faces]
    if np.abs(wanted).max() < 1e-9:
        raise StudyError("it moves no surface of the mesh")
    count = len(mesh.nodes)
    ends = np.unique(np.sort(mesh.elements[:, [0, 1, 0, 2, 0, 3, 1, 2, 1, 3, 2, 3]].reshape(-1, 2), axis=1), axis=0)
    rows = np.arange(len(ends))
    along = sparse.csr_array((np.ones(len(ends)), (rows, ends[:, 0])), (len(ends), count))
    along = along - sparse.csr_array((np.ones(len(ends)), (rows, ends[:, 1])), (len(ends), count))
    places = np.repeat(np.arange(len(own.nodes)), 3), (3 * own.nodes[:, None] + np.arange(3)).ravel()
    on_faces = sparse.csr_array((normal.ravel(), places), (len(own.nodes), 3 * count))
    matrix = sparse.kron(along.T @ along, sparse.eye_array(3)) + HELD * on_faces.T @ on_faces
    move: np.ndarray = spsolve(sparse.csc_array(matrix), HELD * on_faces.T @ wanted)
    if np.abs(on_faces @ move - wanted).max() > MISSED * np.abs(wanted).max():
        raise StudyError("faces that meet in a node of the mesh part")
    return move.reshape(-1, 3)


# The descent of an optimisation: trials whose runs have the gradient of the objective.

SHAPES = "shapes"
HALF = 1e-3
"""Change of a dimension by which the moves of its faces are found, over its range [-]."""
TOLERANCE, STILL = 1e-3, 1e-3
"""Part of the first value by which a step must better the objective, and of the ranges that ends the rounds [-]."""


def run_descent(
    study: Optimisation, folder: Path, trials: Any, workers: Workers, done: Callable[[Any, Mapping[str, Any]], None]
) -> None:
    """Make trials along gradients, as `run_trials` makes those of a sampler; the same command goes on where it ended.

    Dimensions move the nodes of the mesh of the start; where the descent ends a new mesh is made, and it begins again
    there, until it stays there.
    """
    from optuna.trial import TrialState

    (objective,) = study.objectives.values()
    request = gradient_request(study)
    ranges = {key: values for key, values in study.variables.items() if isinstance(values, Range)}
    sign = -1.0 if objective.maximise else 1.0
    start = study.start
    point = np.array([share_of(span, start[key]) if key in start else 0.5 for key, span in ranges.items()])
    while True:
        shape = Shape(study, folder, _values(ranges, point), request)

        def value_and_slope(at: np.ndarray, shape: "Shape" = shape) -> tuple[float, np.ndarray] | None:
            values = _values(ranges, at)
            try:
                name = shape.runs(values).jobs[""].name
            except MeshError:
                return None
            while (trial := _ended(trials, name)) is None:
                if len(counted(trials)) >= study.trials:
                    raise Enough
                if not trials.get_trials(deepcopy=False, states=(TrialState.WAITING,)):  # of the start, or taken over
                    trials.enqueue_trial(values)
                more = study.model_copy(update={"trials": len(counted(trials)) + 1})
                run_trials(more, folder, trials, workers, done, shape.runs)
            record = read_record(folder / RUNS / name)
            assert record is not None
            if trial.values is None:
                if trial.number == 0:
                    raise StudyError(f"the run of the start: {record['status']}: {record['message']}")
                return None
            slopes = [record["metrics"]["gradient"][key] * rate_of(span, values[key]) for key, span in ranges.items()]
            if trial.number == 0 and not any(slopes):
                raise StudyError("the objective changes with no variable at the start; begin elsewhere, by [start]")
            return sign * trial.values[0], sign * np.array(slopes)

        before, point = point, descend(value_and_slope, point, study.trials, TOLERANCE)
        if not shape.moves or np.abs(point - before).max() < STILL or len(counted(trials)) >= study.trials:
            return


def _ended(trials: Any, name: str) -> Any:
    """The trial with a run of this name that has ended; None without one."""
    ended = (one for one in counted(trials) if one.state.is_finished())
    return next((one for one in ended if one.user_attrs.get(RUNS_OF_TRIAL) == {"": name}), None)


class Shape:
    """The scene of a round: meshes made for the values that it begins with, and how keys change them.

    Attributes:
        moves: by dimension and body, moves of the nodes [mm per unit], shape (node_count, 3).
    """

    def __init__(self, study: Optimisation, folder: Path, values: Mapping[str, float], request: Mapping[str, Any]):
        self._study, self._folder, self._first, self._request = study, folder.resolve(), values, request
        self.moves: dict[str, dict[str, np.ndarray]] = {}
        self._meshes: dict[str, VolumeMesh] = {}
        by_key = {key: factors(self._scene, values, key) for key in values if is_of_scene(key)}
        for key in values:  # in their order, as sums round by it, and runs go by the bits of their meshes
            if key not in by_key:
                self.moves[key] = self._moves(key)
        self._meshed = {  # as the study has those that no dimension moves
            f"soft_bodies.{name}.mesh": {"file": body.mesh.file, **body.mesh.request}
            for name, body in self._scene(values).soft_bodies.items()
            if name not in self._meshes and is_geometry(body.mesh.file)
        }
        files = {key: {body: self._kept_move(move) for body, move in of.items()} for key, of in self.moves.items()}
        self._request = {**request, "factors": by_key, "moves": files}

    def _scene(self, values: Mapping[str, Any]) -> Scene:
        return scene_with(self._study.scene, {**fixed_overrides(self._study), **values}, self._study.controller)

    def _moves(self, key: str) -> dict[str, np.ndarray]:
        span = self._study.variables[key]
        assert isinstance(span, Range)
        half, here, moves = HALF * (span.high - span.low), self._scene(self._first), {}
        sides = [self._scene({**self._first, key: self._first[key] + sign * half}) for sign in (1.0, -1.0)]
        for name, body in here.soft_bodies.items():
            if is_geometry(body.mesh.file) and any(side.soft_bodies[name].mesh != body.mesh for side in sides):
                mesh, *others = (_mesh(scene, name) for scene in (here, *sides))
                if mesh.elements.shape[1] != 4:
                    raise StudyError(f"{key}: has no gradient with elements of second order; take mesh.order = 1")
                try:
                    moves[name] = moves_of_nodes(mesh, others[0], others[1], half)
                except StudyError as error:
                    raise StudyError(
                        f"variables.{key}: has no gradient at {self._first[key]:g}, since {error}"
                    ) from error
                self._meshes[name] = mesh
        return moves

    def runs(self, values: Mapping[str, Any]) -> TrialRuns:
        """The run of a trial, with the meshes moved; raises MeshError where that turns elements over."""
        given = {**self._meshed, **{key: value for key, value in values.items() if key not in self.moves}}
        for body, mesh in self._meshes.items():
            nodes = mesh.nodes.copy()
            for key, of in self.moves.items():
                nodes += (values[key] - self._first[key]) * of.get(body, 0.0)
            moved = replace(mesh, nodes=nodes).check()
            path = self._place(nodes, ".msh")
            if not path.is_file():
                write_volume_mesh(moved, path)
            given[f"soft_bodies.{body}.mesh"] = {"file": str(path)}
        fixed = tuple(text for text in self._study.set if is_of_scene(text.partition("=")[0].strip()))
        study = self._study.model_copy(update={"set": fixed})
        job = job_for(study, given, self._folder, study.seed, gradient=self._request)
        return TrialRuns({"": replace(job, parameters=dict(values))})

    def _kept_move(self, move: np.ndarray) -> str:
        path = self._place(move, ".npz")
        if not path.is_file():  # written twice it would differ by its time, and runs by its name
            with atomic_file(path, StudyError) as partial, partial.open("wb") as file:
                np.savez(file, move=move)
        return str(path)

    def _place(self, array: np.ndarray, suffix: str) -> Path:
        place = self._folder / SHAPES
        place.mkdir(parents=True, exist_ok=True)
        return place / f"{hashlib.sha256(array.tobytes()).hexdigest()[:16]}{suffix}"


def _mesh(scene: Scene, body: str) -> VolumeMesh:
    source = scene.soft_bodies[body].mesh
    return mesh_for_scene(Path(source.file), **source.request)


def gradient_request(study: Optimisation) -> dict[str, Any]:
    """What a run derives; raises StudyError where the objective reads what has no derivative."""
    final = {
        figure.metric("final"): (figure.field, 180.0 / np.pi if figure.unit == "degrees" else 1.0)
        for figure in FIGURES
        if In.FINAL in figure.recorded and figure.field in FigureSlopes.KNOWN
    }
    ((name, objective),) = study.objectives.items()
    known, where = [*final, VOLUMES, PARAMETERS], f"objectives.{name}.{objective.key}"
    for metric in sorted(Expression(objective.text, where).names):
        if metric not in known:
            raise StudyError(f"{where}: '{metric}' has no gradient here; {nearest(metric, known, 'there are')}")
    return {"objective": objective.text, "figures": final}


def _values(ranges: Mapping[str, Range], point: np.ndarray) -> dict[str, float]:
    values = {}
    for (key, span), share in zip(ranges.items(), point.tolist(), strict=True):
        values[key] = min(max(float(f"{value_at(span, share):.10g}"), span.low), span.high)
    return values
