"""The runs of the training and of the validation of a scene."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft import Scene
from taichisoft.errors import TaichisoftError
from taichisoft.scenes import scene_from_dict, scene_to_toml
from taichisoft_reduction.actuator_ranges import Ranges
from taichisoft_reduction.body_shapes import BodyShape, mesh_digest
from taichisoft_reduction.excitations import beyond, excitations, ramp, unseen
from taichisoft_reduction.pressing import press_timetable, presses
from taichisoft_reduction.run_request import RunResult, Timetable, TrainingRun

if TYPE_CHECKING:
    from taichisoft import Model

OWN_RUN = "own-run"
OWN_FRAMES = 120
"""Moments that are kept of a run of the validation."""
WEAKER, STRONGER = 0.75, 1.2
"""Factors on what the scene's own controller asks for, in the training."""
SHIFT = 0.15
"""How far the base is shaken, as a share of the body's largest extent."""
SOLID = ("surface", "scale", "smooth", "box", "sphere", "cylinder", "capsule", "inertia", "centre_of_mass", "density")
"""Keys of a rigid body that say what it is made of."""


class TrainingPlan:
    """Makes the requests for the runs of a scene.

    Attributes:
        model: the model of the scene.
        shapes: the soft bodies that are reduced.
    """

    def __init__(self, scene: Scene, model: "Model", shapes: Sequence[BodyShape], plugins: Sequence[str]):
        """Plan for a scene; `plugins` are paths of the plug-ins that it needs."""
        self.model, self.shapes = model, shapes
        self._scene = scene
        self._tables = scene.model_dump(exclude_none=True)
        self._common: dict[str, Any] = {"plugins": tuple(plugins), "files": mesh_digest(model.soft_bodies)}
        self._all_bodies = tuple(name for shape in shapes for name in shape.bodies)
        self._bodies = {body.name: body for body in model.soft_bodies}

    def own_run(self) -> TrainingRun | None:
        """The scene's own run, for the validation; None without a controller."""
        return self._own(OWN_RUN, self._scene, frames=OWN_FRAMES) if self._scene.controller is not None else None

    def first_runs(self, ranges: Mapping[str, Ranges]) -> list[TrainingRun]:
        """Ramps of each shape, by which the places to press are found."""
        return [self._alone(shape, "ramp", ramp(own)) for shape in self.shapes if (own := ranges[shape.name])]

    def training(
        self, ranges: Mapping[str, Ranges], ramps: Mapping[str, RunResult], own: Sequence[RunResult]
    ) -> list[TrainingRun]:
        """All runs of the training, those of `first_runs` first."""
        found = self.first_runs(ranges)
        for shape in self.shapes:
            tables = excitations(ranges[shape.name], self._scene.gravity, self._shift(shape))
            found += [self._alone(shape, name, table) for name, table in tables.items() if name != "ramp"]
            found += self._presses(shape, ranges[shape.name], ramps.get(shape.name), own, False)
        return found + self._grasps()

    def validation(
        self, ranges: Mapping[str, Ranges], ramps: Mapping[str, RunResult], own: Sequence[RunResult]
    ) -> list[TrainingRun]:
        """Runs that are not trained on: the scene's own first, if it has a controller."""
        first = self.own_run()
        found = [] if first is None else [first]
        for shape in self.shapes:
            tables = unseen(ranges[shape.name], self._shift(shape))
            found += [self._alone(shape, name, table, OWN_FRAMES) for name, table in tables.items()]
            found += self._presses(shape, ranges[shape.name], ramps.get(shape.name), own, True)
        return found + [
            self._own("unseen-grasp", scene, frames=OWN_FRAMES)
            for scene in self._with_object(lambda size: {"box": (0.93 * size).tolist()})
        ]

    def beyond(self, ranges: Mapping[str, Ranges]) -> list[TrainingRun]:
        """Runs far beyond the training, in which reduced bodies are expected to err."""
        tables = {shape: beyond(ranges[shape.name], self._scene.gravity) for shape in self.shapes}
        return [self._alone(shape, *table, OWN_FRAMES) for shape, some in tables.items() for table in some.items()]

    def _grasps(self) -> list[TrainingRun]:
        """The scene's own run with other efforts, and with other objects in the place of its own."""
        if self._scene.controller is None:
            return []
        objects: Mapping[str, Callable[[np.ndarray], dict[str, Any]]] = {
            "ball": lambda size: {"sphere": {"radius": 0.5 * float(size.min())}},
            "box": lambda size: {"box": (0.8 * size).tolist()},
            "cylinder": lambda size: {
                "cylinder": {"radius": 0.5 * float(min(size[:2])), "length": float(size[2])},
            },
        }
        found = [
            self._own("own-weaker", self._scene, factor=WEAKER),
            self._own("own-stronger", self._scene, factor=STRONGER),
        ]
        for name, make in objects.items():
            found += [self._own(f"grasp-{name}", scene) for scene in self._with_object(make)]
        return found

    def _with_object(self, make: Callable[[np.ndarray], dict[str, Any]]) -> list[Scene]:
        """The scene with another shape, made of the extents [mm], in the place of its main object, if it has one."""
        name = self._scene.main_object
        rigid = next((body for body in self.model.rigid_bodies if body.name == name), None)
        if rigid is None or name is None:
            return []
        table = {key: value for key, value in self._tables["rigid_bodies"][name].items() if key not in SOLID}
        table |= make(np.ptp(rigid.vertices, axis=0))
        table |= {"mass": rigid.mass, "position": rigid.start_position.tolist()}
        return self._valid({**self._tables, "rigid_bodies": {**self._tables["rigid_bodies"], name: table}})

    def _presses(
        self, shape: BodyShape, ranges: Ranges, ramp: RunResult | None, own: Sequence[RunResult], is_unseen: bool
    ) -> list[TrainingRun]:
        body = self._bodies[shape.name]
        if not body.settings.collides:
            return []
        touched = np.zeros(len(body.rest_position), bool)
        for result, name in itertools.product(own, shape.bodies):
            if name in result.touched:
                touched |= result.touched[name]
        size = self._size(shape)
        gap = self._scene.contact.contact_distance
        found = []
        for number, press in enumerate(presses(body, ramp, touched, gap, is_unseen)):
            table = press_timetable(ranges, press, size, 1.0 if not is_unseen else 0.8)
            name = f"press-{number}" if not is_unseen else "unseen-press"
            for scene in self._valid({**self._alone_tables(shape), "obstacles": {"press": press.obstacle}}):
                found.append(
                    self._request(f"{shape.name}-{name}", scene, (shape.name,), table, OWN_FRAMES if is_unseen else 24)
                )
        return found

    def _alone(self, shape: BodyShape, name: str, table: Timetable, frames: int = 24) -> TrainingRun:
        """A run of the first body of a shape alone, or with all soft bodies where it cannot be alone."""
        scenes = self._valid(self._alone_tables(shape)) or self._valid(self._without(self._tables, "obstacles"))
        scene = scenes[0] if scenes else self._scene
        return self._request(f"{shape.name}-{name}", scene, (shape.name,), table, frames)

    def _alone_tables(self, shape: BodyShape) -> dict[str, Any]:
        tables = self._without(self._tables, "obstacles", "rigid_bodies", "goal", "external_forces")
        tables["soft_bodies"] = {shape.name: self._tables["soft_bodies"][shape.name]}
        tables["contact"] = {key: value for key, value in self._tables["contact"].items() if key != "pairs"}
        return tables

    @staticmethod
    def _without(tables: Mapping[str, Any], *keys: str) -> dict[str, Any]:
        return {key: value for key, value in tables.items() if key not in (*keys, "controller")}

    @staticmethod
    def _valid(tables: Mapping[str, Any]) -> list[Scene]:
        """The scene of these tables; none where it is not valid, such as that of a cable whose other body is gone."""
        try:
            return [scene_from_dict(tables)]
        except TaichisoftError:
            return []

    def _own(self, name: str, scene: Scene, factor: float = 1.0, frames: int = 40) -> TrainingRun:
        return TrainingRun(
            name,
            scene_to_toml(scene),
            self._all_bodies,
            scene.time.duration,
            factor=factor,
            frames=frames,
            **self._common,
        )

    def _request(self, name: str, scene: Scene, bodies: tuple[str, ...], table: Timetable, frames: int) -> TrainingRun:
        duration = max(scene.time.step, round(table.duration / scene.time.step) * scene.time.step)
        return TrainingRun(name, scene_to_toml(scene), bodies, duration, table, frames=frames, **self._common)

    def _size(self, shape: BodyShape) -> float:
        return float(np.ptp(self._bodies[shape.name].rest_position, axis=0).max())

    def _shift(self, shape: BodyShape) -> float:
        return SHIFT * self._size(shape)
