"""The base class of environments: a scene, actions, observations, a reward, and the page of a run."""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, ClassVar

import gymnasium
import numpy as np

from taichisoft import Scene
from taichisoft.control import Control, Controller, Force, Observation
from taichisoft.errors import SceneError, SimulationDiverged, nearest
from taichisoft.mechanics import State
from taichisoft.running import Session, load_scene, make_output, notify, with_reduced_bodies
from taichisoft.scene import RigidBodySettings, scene_from_dict
from taichisoft_gym.actuation import Actuation, ArmTravel, Travel, scene_axes
from taichisoft_gym.channels import (
    Channel,
    action_values,
    box_of,
    finite,
    numbers,
    read_groups,
    saturated,
    share,
    whole_steps,
)
from taichisoft_gym.episode_start import Drawn, Randomisation
from taichisoft_gym.observed_quantities import Quantity, make_group

if TYPE_CHECKING:
    from taichisoft.running import Simulation
    from taichisoft_gym.episode_start import EpisodeStart

# The live page of an environment in a browser, which the output "web" serves.


class FromOutside(Controller):
    """Controller without requests, because the user steps the environment."""

    def control(self, observation: Observation) -> Control:
        """Return an empty request."""
        return Control()


class EnvironmentPage:
    """A page in the browser, whose address is printed."""

    def __init__(self, simulation: "Simulation"):
        """Serve the page."""
        self._folder = TemporaryDirectory(prefix="taichisoft-page-")
        self._output = make_output("web", self._folder.name)
        self._session = Session(simulation, FromOutside(), [self._output], duration=inf)
        notify("taichisoft_run_begins", session=self._session)

    def show(self, simulation: "Simulation") -> None:
        """Show the state of a simulation of the same bodies."""
        self._session.simulation = simulation
        self._output.restart(simulation.state)

    def close(self) -> None:
        """Close the page."""
        self._output.end("closed")
        notify("taichisoft_run_ends", session=self._session, outcome="closed")
        self._folder.cleanup()


# The scene of an environment, with the changes by its arguments.


USUAL_RATE = 300.0
"""Default fastest change of a pressure [kPa/s]."""


def changed_scene(scene: Scene, object: Any, friction: float | None, limits: Mapping[str, float]) -> Scene:
    """A scene with other limits, another coefficient of friction, or other keys of its object.

    A shape or surface in `object` replaces the present one.
    """
    tables = scene.model_dump(mode="json", exclude_none=True)
    tables["limits"] |= limits
    if friction is not None:
        tables["contact"]["friction"] = friction
    if object is not None:
        if not isinstance(object, Mapping):
            raise SceneError(f"object = {object!r}: must be a dictionary of keys of a rigid body")
        if scene.main_object is None:
            raise SceneError("object: the scene has no rigid body to change")
        table = tables["rigid_bodies"][scene.main_object]
        replaced = {key for keys in RigidBodySettings.alternatives if set(keys) & object.keys() for key in keys}
        kept = {key: value for key, value in table.items() if key not in replaced}
        tables["rigid_bodies"][scene.main_object] = {**kept, **object}
    return scene_from_dict(tables, "scene of the environment")


def pressure_limits(
    scene: Scene, pressure: Any, rate: float | None, usual: tuple[float, float]
) -> tuple[float, float, float]:
    """Pressures of the actions -1 and 1 [kPa] and their fastest change [kPa/s], within the limits of the scene.

    Beyond these an action would have no effect. None stands for the usual ones, as far as the limits allow.
    """
    ends = np.array(usual) if pressure is None else numbers(pressure)
    if ends.shape != (2,) or not np.isfinite(ends).all():
        raise SceneError(f"pressure = {pressure!r}: must be a lowest and a highest pressure [kPa]")
    low, high = ends.tolist()
    tables: dict[str, Any] = {"limits": scene.limits}
    for name, body in scene.soft_bodies.items():
        tables |= {f"soft_bodies.{name}.cavities.{cavity}": table for cavity, table in body.cavities.items()}
    tables |= {f"air.sources.{name}": source for name, source in scene.air.sources.items()}
    for key, table in tables.items():
        for end, limit in (("lowest", table.lowest_pressure), ("highest", table.highest_pressure)):
            if limit is None:
                continue
            if pressure is None:
                low, high = (max(low, limit), high) if end == "lowest" else (low, min(high, limit))
            elif low < limit if end == "lowest" else high > limit:
                raise SceneError(
                    f"pressure = ({low:g}, {high:g}): goes beyond {key}.{end}_pressure = {limit:g} kPa of the scene; a "
                    "part of every action's range would do nothing"
                )
    if not low < high:
        raise SceneError(f"pressure = ({low:g}, {high:g}): the first must be below the second [kPa]")
    fastest = math.inf if scene.limits.pressure_rate is None else scene.limits.pressure_rate
    if rate is not None and rate > fastest:
        raise SceneError(f"pressure_rate = {rate:g}: goes beyond limits.pressure_rate = {fastest:g} kPa/s of the scene")
    return low, high, min(USUAL_RATE, fastest) if rate is None else rate


# Environments of one's own: a task is a class with a scene, actions, observations, a reward.

Readings = np.ndarray | dict[str, np.ndarray]
"""An observation: numbers, or with `goals=True` a dictionary of observation, achieved_goal and desired_goal."""


class SoftRobotEnvironment(gymnasium.Env[Any, np.ndarray]):
    """A task with soft robots: subclasses set the class attributes that they need and write `reward`.

    The simulator starts at the first `reset`, so that a process that only uses the spaces can still fork. The scene's
    `[sensors]` disturb the observations; `reward`, `terminated` and `information` get the exact figures.

    Attributes:
        usual_scene: scene of the task, unless the argument `scene` names another.
        usual_pressure: pressures of the actions -1 and 1 [kPa], unless the argument `pressure` gives others.
        actions: what actions drive: "pressure", "volume_growth", "valve", "cable_tension", "cable_pull"; of an actuator
            the first that it can be driven by. Empty: the usual one of every actuator.
        travel: range and speed of the base, or an `ArmTravel`; None: it stands still.
        observations: what is observed, by the names in `observed_quantities`, or functions of the environment that
            return a `ChannelGroup`.
        goal_channels: name, unit and range of each number of a goal; empty: the task has no goal.
        goal_reach: range of "way to the target" in each direction.
        goal_options: names of options of `reset` that `begin` takes.
        tolerance: distance within which a goal is reached.
        desired_goal: the goal, which `begin` sets, shape (goal_count,).
        scene: simulated scene, with the changes by the arguments.
        axes: unit vectors to the right, to the front and up, as rows, shape (3, 3).
        channels: name, unit and range of each number of an observation.
        action_channels: name, unit, and values at -1 and 1 of each number of an action.
        action_change: mean change of the action since the last control period [-], 0 in the first.
        control_period: time between two actions [s].
        difficulty: from 0 to 1, for a curriculum: the share of all ranges from which `reset` draws. May be set at any
            time, by the option "difficulty" of `reset` as well.
        simulation: simulation of the episode; randomisation changes its state and its model.
        start_of_object: centre of mass of the object at the start of the episode [mm], shape (3,).
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        "render_modes": ["rgb_array", "human"],
        "render_fps": 20,
    }
    usual_scene: ClassVar[str | Path | Scene] = "gripper"
    usual_pressure: ClassVar[tuple[float, float]] = (0.0, 100.0)
    actions: ClassVar[Sequence[str]] = ()
    travel: Travel | ArmTravel | None = None
    observations: ClassVar[Sequence[Quantity]] = ("actuators",)
    goal_channels: tuple[Channel, ...] = ()
    goal_reach: float = 200.0
    goal_options: ClassVar[Sequence[str]] = ()
    tolerance: float = 1.0
    desired_goal: np.ndarray
    scene: Scene
    axes: np.ndarray
    channels: tuple[Channel, ...]
    action_channels: tuple[Channel, ...]
    action_change: float
    control_period: float
    difficulty: float
    simulation: "Simulation"
    start_of_object: np.ndarray

    def __init__(
        self,
        scene: str | Path | Scene | None = None,
        reduced: str | Path | None = None,
        object: Mapping[str, Any] | None = None,
        objects: Mapping[str, Mapping[str, Any]] | None = None,
        friction: float | None = None,
        pressure: tuple[float, float] | None = None,
        pressure_rate: float | None = None,
        noise: float = 0.0,
        randomisation: Randomisation | Mapping[str, Any] | None = None,
        difficulty: float = 1.0,
        goals: bool = False,
        control_period: float = 0.05,
        render_mode: str | None = None,
        camera: str | Sequence[Sequence[float]] = "iso",
        size: tuple[int, int] = (640, 480),
    ):
        """Read the scene.

        Args:
            scene: scene, or its name or path; None: `usual_scene`.
            reduced: folder of `taichisoft reduce`, by whose files soft bodies move; None: as the scene says.
            object: changed keys of the scene's object, such as {"mass": 0.01} or another shape.
            objects: such changes by a name of the object; every reset draws one.
            friction: Coulomb's coefficient [-]; None: the scene's.
            pressure: pressures of the actions -1 and 1 [kPa], within the limits of the scene and its cavities; None:
                `usual_pressure` within these limits.
            pressure_rate: fastest change of a pressure [kPa/s]; None: 300, or the scene's if lower.
            noise: standard deviation of the observation, relative to each channel's range [-].
            randomisation: ranges for the random draws of every reset, see `Randomisation`.
            difficulty: share of all ranges from which resets draw, from 0 to 1.
            goals: whether observations are dictionaries with the goal, and rewards are `goal_reward`, which is
                `compute_reward` as well (as of GoalEnv in gymnasium-robotics), for hindsight experience replay.
            control_period: time between two actions [s].
            render_mode: "rgb_array", or "human" for a page in the browser.
            camera: camera of pictures, see `Simulation.render`.
            size: width and height of pictures [pixels].

        Raises:
            SceneError: the scene or an argument is not valid.
        """
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise SceneError(f"render_mode = {render_mode!r}: must be one of {self.metadata['render_modes']}, or None")
        if goals and not self.goal_channels:
            raise SceneError(f"goals = True: {type(self).__name__} has no goal; set its goal_channels")
        if goals:  # Stable-Baselines3 takes every environment with a method of this name for one with goals
            self.compute_reward = self.goal_reward
        scene = self.usual_scene if scene is None else scene
        read = scene if isinstance(scene, Scene) else load_scene(scene)
        if reduced is not None:
            read = with_reduced_bodies(read, Path(reduced), "reduced")
        low, high, rate = pressure_limits(read, pressure, pressure_rate, self.usual_pressure)
        limits = {"lowest_pressure": low, "highest_pressure": high, "pressure_rate": rate}
        if objects is not None and (object is not None or not isinstance(objects, Mapping) or not objects):
            raise SceneError("objects: must be changed keys of the object by at least one name, without object")
        changes = {"": object} if objects is None else objects
        self.scenes = {name: changed_scene(read, one, friction, limits) for name, one in changes.items()}
        self.scene = next(iter(self.scenes.values()))
        self.axes = scene_axes(self.scene)
        self._steps = whole_steps(control_period, self.scene.time.step)
        self.control_period = control_period
        self.difficulty = share("difficulty", difficulty)
        self.randomisation = Randomisation.from_mapping(randomisation)
        if self.randomisation.push is not None and self.scene.main_object is None:
            raise SceneError("randomisation['push']: the scene has no rigid body")
        self.actuation = Actuation(self.scene, (low, high), self.travel, self.actions)
        self.action_channels = self.actuation.channels
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (len(self.action_channels),), np.float32)
        self.desired_goal = np.zeros(len(self.goal_channels))
        self.start_of_object = np.zeros(3)
        # Hindsight changes the goal, but not an observed way to it.
        observed = [one for one in self.observations if not (goals and one == "way to the target")]
        self._quantities = [make_group(self, one) for one in observed]
        self.channels = tuple(one for what in self._quantities for one in what.channels)
        self._space, self._goal_space = box_of(self.channels), box_of(self.goal_channels)
        self._goals, self._noise = goals, noise
        self.observation_space = self._space if not goals else self._dictionary_space()
        self.metadata = {**self.metadata, "render_fps": max(1, round(1.0 / control_period))}  # type: ignore[misc]
        self.render_mode, self._camera, self._size = render_mode, camera, size
        self._starts: dict[str, EpisodeStart] = {}
        self._page: EnvironmentPage | None = None
        self._shown = 0.0
        self._last_action: np.ndarray | None = None
        self.action_change = 0.0

    def begin(self, start: State, options: dict[str, Any]) -> None:
        """Choose the task of an episode with random numbers of `self.np_random`.

        Args:
            start: the state at the start, arrays of the whole model; figures by name, such as `reward` gets of later
                moments, are in the `Observation` that `self.simulation.observe()` returns.
            options: those of `reset`; the ones that the task uses are to be removed.

        Raises:
            SceneError: an option makes no sense.
        """

    def randomise(self) -> Drawn:
        """Draw what differs in this episode: friction [-], factors "mass" and "modulus", "place right" and "place
        front" [mm], and "object", a name of `objects`; what is not drawn is as in the scene.
        """
        drawn = self.randomisation.draw(self.np_random, self.difficulty, self.scene.contact.friction)
        return drawn if len(self.scenes) == 1 else {**drawn, "object": str(self.np_random.choice(list(self.scenes)))}

    def pushes(self) -> Mapping[str, Force | None]:
        """Forces from outside from the next control period on, by body or frame, as of `Control.forces`; by default
        pushes on the object that the argument `randomisation` draws.
        """
        force = self.randomisation.draw_push(self.np_random, self.difficulty)
        return {} if force is None else {self.object: Force(force, steps=self._steps)}

    def update(self, seen: Observation) -> None:
        """Note what the task needs to know of a control period that is over; called before `reward`."""

    def reward(self, seen: Observation) -> float:
        """Reward of a control period that led to `seen`; with a goal and unless overridden, `goal_reward` of it."""
        if not self.goal_channels:
            raise NotImplementedError(f"{type(self).__name__} needs a method reward(self, seen), or goal_channels")
        return float(self.goal_reward(self.achieved_goal(seen), self.desired_goal, {}))

    def terminated(self, seen: Observation) -> bool:
        """Whether the task has failed irrecoverably, or is over for good."""
        return False

    def information(self, seen: Observation) -> dict[str, Any]:
        """Entries of `info`; by custom "is_success" is among them."""
        if not self.goal_channels:
            return {}
        distance = float(np.linalg.norm(self.desired_goal - self.achieved_goal(seen)))
        return {"is_success": distance < self.tolerance, "distance": distance}

    def achieved_goal(self, seen: Observation) -> np.ndarray:
        """Where the task is now, in the numbers of a goal, shape (goal_count,)."""
        raise NotImplementedError(
            f"{type(self).__name__} has goal_channels; it needs a method achieved_goal(self, seen)"
        )

    def goal_reward(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> Any:
        """Reward of goals, shape (..., goal_count): 0 within `tolerance`, else -1, shape (...)."""
        distance = np.linalg.norm(np.asarray(achieved_goal, float) - np.asarray(desired_goal, float), axis=-1)
        return -(distance >= self.tolerance).astype(np.float64)

    def marks(self) -> np.ndarray:
        """Points marked by `render`, such as targets [mm], shape (mark_count, 3)."""
        return np.zeros((0, 3))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Readings, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: seed that makes this and all later episodes repeatable bit for bit.
            options: "state", a `taichisoft.State` to start from without randomisation; "difficulty"; and options of the
                task.

        Raises:
            SceneError: an option is unknown, or no free place was found for the object.
            StateError: the state belongs to another model, or has a value that is not finite.
        """
        super().reset(seed=seed)
        options = dict(options or {})
        given = options.pop("state", None)
        self.difficulty = share("options['difficulty']", options.pop("difficulty", self.difficulty))
        drawn = {} if given is not None else self.randomise()
        self._begin_simulation(given, drawn)
        start = self.simulation.state
        if self.scene.main_object is not None:
            self.start_of_object = start.rigid_position[list(self.scene.rigid_bodies).index(self.object)].copy()
        self._last_action, self.action_change = None, 0.0
        self.begin(start, options)
        if options:
            there_are = ", ".join(("state", "difficulty", *self.goal_options))
            raise SceneError(f"options: there is no '{next(iter(options))}'; there are: {there_are}")
        seen = self.simulation.observe()
        info = {**self.information(seen.truth), "randomised": drawn}
        self._show()
        return self._measure(seen), info

    def step(self, action: np.ndarray) -> tuple[Readings, float, bool, bool, dict[str, Any]]:
        """Simulate one control period.

        An episode is truncated when the simulation diverges, which is not a failure of the task; info then has
        "diverged". Its "stretch_over_law" is the largest of `StepReport`: above 1 a body is beyond its law. Actions are
        clipped to -1 and 1, for the motion and for the reward.

        Raises:
            ResetNeeded: no episode has begun.
            SceneError: the action has another number of entries than `action_space`, or a value that is not finite.
        """
        self._refuse_before_reset()
        request = action_values(action, len(self.action_channels))
        control, diverged = self.actuation.control(request, self.simulation, self.control_period), {}
        if forces := self.pushes():
            control = replace(control, forces=forces)
        try:
            for number in range(self._steps):
                self.simulation.step(None if number else control)  # what was asked for goes on
        except SimulationDiverged as error:
            diverged = {"diverged": str(error)}
        seen = self.simulation.observe()
        self.action_change = 0.0 if self._last_action is None else float(np.abs(request - self._last_action).mean())
        self._last_action = request
        self.update(seen.truth)
        stretch = max((self.simulation.report.stretch_over_law if self.simulation.report else {}).values(), default=0.0)
        info = {**self.information(seen.truth), "stretch_over_law": stretch, **diverged}
        readings = self._measure(seen)
        if isinstance(readings, dict):
            reward = self.goal_reward(readings["achieved_goal"], readings["desired_goal"], info)
        else:
            reward = self.reward(seen.truth)
        self._show()
        return readings, finite("reward", reward), bool(self.terminated(seen.truth)), bool(diverged), info

    def render(self) -> np.ndarray | None:  # type: ignore[override]
        """Picture of the present state with a mark at the target, shape (height, width, 3), dtype uint8.

        None unless the render mode is "rgb_array".
        """
        if self.render_mode != "rgb_array":
            return None
        return self.picture(self._camera, self._size, self.marks())

    def picture(
        self,
        camera: str | Sequence[Sequence[float]],
        size: tuple[int, int],
        marks: Sequence[Sequence[float]] | np.ndarray = (),
    ) -> np.ndarray:
        """Picture of the present state; arguments and result as for `Simulation.render`.

        Raises:
            ResetNeeded: no episode has begun.
        """
        self._refuse_before_reset()
        return self.simulation.render(camera, size, marks=marks)

    def close(self) -> None:
        """Close the renderers and the page."""
        for start in self._starts.values():
            start.simulation.close()
        self._close_page()

    @cached_property
    def fingers(self) -> tuple[str, ...]:
        """Names of the soft bodies with anchors."""
        return tuple(name for name, body in self.scene.soft_bodies.items() if body.anchors)

    @property
    def finger(self) -> str:
        """Name of the first finger.

        Raises:
            SceneError: no soft body has anchors.
        """
        if self.fingers:
            return self.fingers[0]
        raise SceneError("this needs a scene with a soft body that has anchors")

    @property
    def cavities(self) -> tuple[str, ...]:
        """Names of the cavities."""
        return self.actuation.cavities

    @cached_property
    def object(self) -> str:
        """Name of the rigid body of the task.

        Raises:
            SceneError: the scene has no rigid body.
        """
        if self.scene.main_object is None:
            raise SceneError("this needs a scene with a rigid body; it has none")
        return self.scene.main_object

    def way_of_object(self, seen: Observation) -> np.ndarray:
        """Displacement of the object since the start of the episode: right, front and up [mm], shape (3,)."""
        way: np.ndarray = self.axes @ (seen.object_positions[self.object] - self.start_of_object)
        return way

    def _dictionary_space(self) -> gymnasium.spaces.Dict:
        goal = self._goal_space
        return gymnasium.spaces.Dict({"observation": self._space, "achieved_goal": goal, "desired_goal": goal})

    def _refuse_before_reset(self) -> None:
        if not self._starts:
            raise gymnasium.error.ResetNeeded("no episode has begun: call reset() first")

    def _begin_simulation(self, given: State | None, drawn: Drawn) -> None:
        """Set the simulation to the start of an episode."""
        from taichisoft_gym.episode_start import EpisodeStart

        name = str(drawn.get("object", next(iter(self.scenes))))
        if name not in self.scenes:
            raise SceneError(f"randomise() drew the object '{name}'; {nearest(name, list(self.scenes), 'there are')}")
        if name not in self._starts:
            places = any(one.startswith("place ") for one in drawn) or bool(self.randomisation.place)
            self._starts[name] = EpisodeStart(self.scenes[name], places)
        start = self._starts[name]
        if self._page is not None and self.scene is not self.scenes[name]:
            self._close_page()  # a page shows the bodies that it began with
        self.scene, self.simulation = self.scenes[name], start.simulation
        start.begin(given, drawn, lambda: self.randomisation.draw_place(self.np_random, self.difficulty))
        if given is None and self.simulation.state.sensor_memory.size:
            memory = self.simulation.state.sensor_memory.copy()
            memory[0] = self.np_random.integers(2**32)
            memory[1] = 0.0
            self.simulation.restore(self.simulation.state.changed(sensor_memory=memory))

    def _measure(self, seen: Observation) -> Readings:
        """The observation, with noise."""
        values = read_groups(self._quantities, seen)
        if self._noise:
            spread = self._noise * (self._space.high.astype(np.float64) - self._space.low)
            values = values + spread * self.np_random.standard_normal(len(values))
        readings = saturated(values, self._space)
        if not self._goals:
            return readings
        achieved, desired = self.achieved_goal(seen.truth), self.desired_goal
        return {
            "observation": readings,
            "achieved_goal": saturated(achieved, self._goal_space, "achieved_goal"),
            "desired_goal": saturated(desired, self._goal_space, "desired_goal"),
        }

    def _show(self) -> None:
        """Show the state in a browser, in real time."""
        if self.render_mode != "human":
            return
        if self._page is None:
            self._page = EnvironmentPage(self.simulation)
        self._page.show(self.simulation)
        time.sleep(max(0.0, self._shown + self.control_period - time.monotonic()))
        self._shown = time.monotonic()

    def _close_page(self) -> None:
        if self._page is not None:
            self._page.close()
            self._page = None
