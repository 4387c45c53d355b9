"""The start of an episode: what is drawn at random, where objects are put, and the state at rest."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any, Self

import numpy as np

from taichisoft import Scene
from taichisoft.base import matrices_from_quaternions
from taichisoft.contact import ContactDetection, Model, MovingSurfaces, Overlap, overlaps
from taichisoft.errors import SceneError, nearest
from taichisoft.mechanics import State
from taichisoft.running import Simulation
from taichisoft.scene import scene_from_toml, scene_to_toml
from taichisoft_gym.actuation import scene_axes
from taichisoft_gym.channels import share

# Places where the object of a task can start: not within another body.


class FreePlaces:
    """Checks whether the object at another place would overlap another body and be thrown away."""

    def __init__(self, model: Model, start: State, body: str):
        """Make the contact detection.

        Args:
            model: the bodies.
            start: state with the object in its original place; overlaps with its support there do not count.
            body: name of the object.
        """
        self._model, self._body = model, model.body_names.index(body)
        self._moving = MovingSurfaces(model.surfaces)
        self._detection = ContactDetection(model.surfaces, self._moving)
        self._allowed: set[tuple[int, int]] = set()
        self._allowed = {found.bodies for found in self._overlaps(start)}

    def problem(self, state: State) -> str:
        """Overlap of the object in a state, in one line; empty without overlap."""
        return next((found.problem for found in self._overlaps(state)), "")

    def _overlaps(self, state: State) -> list[Overlap]:
        rotation: np.ndarray = matrices_from_quaternions(state.rigid_rotation)
        self._moving.update(state.position, state.rigid_position, rotation)
        found = overlaps(self._model.surfaces, self._moving, self._detection, self._model.body_names, self._body)
        return [one for one in found if one.bodies not in self._allowed]


# Randomisation of episodes: friction, masses, stiffness, place of the object.

Range = tuple[float, float]
Drawn = dict[str, float | str]
"""What was drawn for an episode by name; a text is the name of an object."""
DRAWABLE = ("friction", "mass", "modulus", "place right", "place front", "object")
"""What can be drawn for an episode."""


@dataclass(frozen=True)
class Randomisation:
    """Ranges for uniform draws at every reset; None or 0: the scene's value.

    Attributes:
        friction: lowest and highest coefficient of friction [-].
        mass: lowest and highest mass of the object, relative to the scene's [-].
        modulus: lowest and highest Young's modulus of all soft bodies, relative to the scene's [-].
        place: largest shift of the object in each horizontal direction [mm]; places within another body are drawn
            again.
        push: lowest and highest amount of a push on the object [mN], in any direction, for a control period.
        push_chance: probability of a push in each control period [-].
    """

    friction: Range | None = None
    mass: Range | None = None
    modulus: Range | None = None
    place: float = 0.0
    push: Range | None = None
    push_chance: float = 0.1

    @classmethod
    def from_mapping(cls, ranges: "Randomisation | Mapping[str, Any] | None") -> Self:
        """Make the ranges from a mapping with the same keys; None: no randomisation."""
        if isinstance(ranges, cls):
            return ranges
        names = [field.name for field in fields(cls)]
        unknown = next((name for name in ranges or () if name not in names), None)  # type: ignore[union-attr]
        if unknown is not None:
            raise SceneError(f"randomisation: there is no '{unknown}'; {nearest(unknown, names, 'there are')}")
        return cls(**dict(ranges or {}))  # type: ignore[arg-type]

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name in ("friction", "mass", "modulus", "push"):
            range_ = getattr(self, name)
            if range_ is not None and not _is_range(range_, zero_is_valid=name in ("friction", "push")):
                raise SceneError(
                    f"randomisation['{name}'] = {range_!r}: must be a lowest and a highest positive number"
                )
        if not _is_range((0.0, self.place), zero_is_valid=True):
            raise SceneError(f"randomisation['place'] = {self.place!r}: must be a distance [mm], not negative")
        share("randomisation['push_chance']", self.push_chance)

    def draw(self, random: np.random.Generator, difficulty: float = 1.0, scene_friction: float = 0.0) -> Drawn:
        """Draw a value for each given range; "place right" and "place front" [mm] for the place.

        Args:
            random: generator.
            difficulty: share of the ranges, counted from the scene's value, that is drawn from [-].
            scene_friction: the scene's coefficient of friction [-].
        """
        ranges = {"friction": self.friction, "mass": self.mass, "modulus": self.modulus}
        drawn: Drawn = {}
        for name, between in ranges.items():
            if between is not None:
                usual = scene_friction if name == "friction" else 1.0
                low, high = ((1.0 - difficulty) * usual + difficulty * end for end in between)
                drawn[name] = random.uniform(low, high)
        return drawn | self.draw_place(random, difficulty)

    def draw_place(self, random: np.random.Generator, difficulty: float = 1.0) -> Drawn:
        """Draw a place of the object; empty if the place is not randomised."""
        if not self.place:
            return {}
        furthest = difficulty * self.place
        return {f"place {axis}": random.uniform(-furthest, furthest) for axis in ("right", "front")}

    def draw_push(self, random: np.random.Generator, difficulty: float = 1.0) -> np.ndarray | None:
        """Draw whether a push begins, and its force [mN], shape (3,); None: there is none."""
        if self.push is None or random.random() >= self.push_chance:
            return None
        direction = random.standard_normal(3)
        force: np.ndarray = difficulty * random.uniform(*self.push) / np.linalg.norm(direction) * direction
        return force


def _is_range(value: Any, zero_is_valid: bool) -> bool:
    try:
        low, high = map(float, value)
    except (TypeError, ValueError):
        return False
    return bool(0.0 <= low <= high and np.isfinite(high)) and (zero_is_valid or low > 0.0)


# Models and initial states of episodes, made once per process.

KEPT = 8


@lru_cache(maxsize=KEPT)
def prepared(scene: str, settling_time: float) -> tuple[Model, State]:
    """Model of a scene in TOML, and its state after a settling time [s] without requests."""
    from taichisoft.running import Simulation

    simulation = Simulation(scene_from_toml(scene, "scene"))
    for _ in range(round(settling_time / simulation.model.scene.time.step)):
        simulation.step()
    return simulation.model, simulation.state


# The start of an episode with an object: the state at rest, with what was drawn.

SETTLING_TIME = 0.3
"""Time before an episode for the object to settle on the floor and the fingers to hang [s]."""
MOST_PLACES = 100
"""Largest number of places drawn for the object until one is free."""


class EpisodeStart:
    """A simulation of a scene, which begins episodes.

    Attributes:
        simulation: the simulation.
    """

    def __init__(self, scene: Scene, places: bool):
        """Make the model, and let everything come to rest; `places`: whether the object's place is drawn."""
        self._scene = scene
        self._model, self._start = prepared(scene_to_toml(scene), SETTLING_TIME)
        self.simulation = Simulation(self._model)
        name = scene.main_object
        if name is None and places:
            raise SceneError("randomisation['place']: the scene has no rigid body")
        self._places = FreePlaces(self._model, self._start, name) if places and name is not None else None

    def begin(self, given: State | None, drawn: Drawn, draw_place: Callable[[], Drawn]) -> None:
        """Set the simulation to a state that was given, or to the state at rest with what was drawn."""
        for name in drawn:
            if name not in DRAWABLE:
                raise SceneError(f"randomise() drew '{name}'; {nearest(name, DRAWABLE, 'there are')}")
        friction, mass = drawn.get("friction"), drawn.get("mass")
        masses = {} if mass is None else {self._object: float(mass) * self._mass_of(self._model)}
        has_changed = bool(masses) or friction is not None
        friction = None if friction is None else float(friction)
        self.simulation.change_model(self._model.varied(friction, masses) if has_changed else self._model)
        self.simulation.restore(given if given is not None else self._placed(drawn, draw_place))

    def _placed(self, drawn: Drawn, draw_place: Callable[[], Drawn]) -> State:
        """The state at rest with the drawn variations; a place within another body is drawn again."""
        start = self._start
        if "modulus" in drawn:
            start = start.changed(young_modulus=float(drawn["modulus"]) * start.young_modulus)
        if self._places is None:
            return start
        problem = ""
        for _ in range(MOST_PLACES):
            placed = self._shifted(start, drawn)
            problem = self._places.problem(placed)
            if not problem:
                return placed
            drawn |= draw_place()
        raise SceneError(
            f"randomisation['place']: none of {MOST_PLACES} places was free; {problem}; take a shorter distance"
        )

    def _shifted(self, start: State, drawn: Drawn) -> State:
        """A state with the object at the drawn place."""
        places, axes = start.rigid_position.copy(), scene_axes(self._scene)
        index = list(self._scene.rigid_bodies).index(self._object)
        places[index] += float(drawn.get("place right", 0.0)) * axes[0] + float(drawn.get("place front", 0.0)) * axes[1]
        return start.changed(rigid_position=places)

    @property
    def _object(self) -> str:
        if self._scene.main_object is None:
            raise SceneError("randomisation['mass']: the scene has no rigid body")
        return self._scene.main_object

    def _mass_of(self, model: Model) -> float:
        return next(body.mass for body in model.rigid_bodies if body.name == self._object)
