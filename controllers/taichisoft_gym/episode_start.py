"""The start of an episode with an object: the state at rest, with what was drawn."""

from collections.abc import Callable

from taichisoft import Scene
from taichisoft.building import Simulation
from taichisoft.errors import SceneError, nearest
from taichisoft.model import Model
from taichisoft.scenes import scene_to_toml
from taichisoft.state import State
from taichisoft_gym.actuation import scene_axes
from taichisoft_gym.places import FreePlaces
from taichisoft_gym.prepared import prepared
from taichisoft_gym.randomisation import DRAWABLE, Drawn

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
        """Set the simulation to a state that was given, or to the state at rest with what was drawn.

        Raises:
            SceneError: no free place was found, or something was drawn that the scene has not.
        """
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
