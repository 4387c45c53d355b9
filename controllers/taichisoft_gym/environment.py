"""Base class of all environments: scene, actions, observations, repeatable episodes, pictures."""

import time
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import gymnasium
import numpy as np

from taichisoft.building import load_scene, with_reduced_bodies
from taichisoft.control import Observation
from taichisoft.errors import SceneError, SimulationDiverged
from taichisoft.scenes import Scene, scene_to_toml
from taichisoft.state import State
from taichisoft_gym import pressures
from taichisoft_gym.actuation import Actuation, Travel, scene_axes
from taichisoft_gym.channels import Channel, ChannelGroup, box_of, saturated
from taichisoft_gym.randomisation import Randomisation
from taichisoft_gym.task import Judgement, changed_scene

if TYPE_CHECKING:  # these import Taichi, which must not start if only the spaces of an environment are used
    from taichisoft.building import Simulation
    from taichisoft.model import Model
    from taichisoft_gym.environment_page import EnvironmentPage
    from taichisoft_gym.places import FreePlaces

SETTLING_TIME = 0.3
"""Time before an episode for the object to settle on the floor and the fingers to hang [s]."""
MOST_PLACES = 100
"""Largest number of places drawn for the object until one is free."""


class SoftRobotEnvironment(gymnasium.Env[np.ndarray, np.ndarray]):
    """Base class of the environments; subclasses define observations and reward of a task.

    The simulator starts at the first `reset`, so that a process that only uses the spaces can still fork.

    Attributes:
        scene: simulated scene, with the changes by the arguments.
        channels: name, unit and range of each number of an observation.
        action_channels: name, unit, and values at -1 and 1 of each number of an action.
        simulation: simulation of all episodes; randomisation changes its state and its model.
        usual_pressure: default pressures of the actions -1 and 1 [kPa].
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        "render_modes": ["rgb_array", "human"],
        "render_fps": 20,
    }
    usual_pressure: ClassVar[tuple[float, float]] = (0.0, 100.0)
    simulation: "Simulation"

    def __init__(
        self,
        travel: Travel | None,
        scene: str | Path | Scene,
        reduced: str | Path | None = None,
        object: Mapping[str, Any] | None = None,
        friction: float | None = None,
        pressure: tuple[float, float] | None = None,
        pressure_rate: float | None = None,
        noise: float = 0.0,
        randomisation: Randomisation | Mapping[str, Any] | None = None,
        control_period: float = 0.05,
        render_mode: str | None = None,
        camera: str | Sequence[Sequence[float]] = "iso",
        size: tuple[int, int] = (640, 480),
    ):
        """Read the scene. All arguments but the first are common to all environments.

        Args:
            travel: range of the base; None: the base stands still.
            scene: scene, or its name or path.
            reduced: folder of `taichisoft reduce`, by whose files soft bodies move; None: as the scene says.
            object: changed keys of the scene's object, such as {"mass": 0.01} or another shape.
            friction: Coulomb's coefficient [-]; None: the scene's.
            pressure: pressures of the actions -1 and 1 [kPa], within the limits of the scene and its cavities; None:
                `usual_pressure` within these limits.
            pressure_rate: fastest change of a pressure [kPa/s]; None: 300, or the scene's if lower.
            noise: standard deviation of the observation, relative to each channel's range [-].
            randomisation: ranges for the random draws of every reset, see `Randomisation`.
            control_period: time between two actions [s].
            render_mode: "rgb_array", or "human" for a page in the browser.
            camera: camera of pictures, see `Simulation.render`.
            size: width and height of pictures [pixels].

        Raises:
            SceneError: the scene or an argument is not valid.
        """
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise SceneError(f"render_mode = {render_mode!r}: must be one of {self.metadata['render_modes']}, or None")
        read = scene if isinstance(scene, Scene) else load_scene(scene)
        if reduced is not None:
            read = with_reduced_bodies(read, Path(reduced), "reduced")
        between = pressures.pressure_range(read, pressure, self.usual_pressure)
        self.scene = changed_scene(read, object, friction, between, pressures.pressure_rate(read, pressure_rate))
        self._scene_text = scene_to_toml(self.scene)
        self._axes = scene_axes(self.scene)
        self._steps = _whole_steps(control_period, self.scene.time.step)
        self._period = control_period
        self._noise = noise
        self._randomisation = Randomisation.from_mapping(randomisation)
        self._actuation = Actuation(self.scene, between, travel)
        self.action_channels = self._actuation.channels
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (len(self.action_channels),), np.float32)
        self._quantities = self._observed()
        self.channels: tuple[Channel, ...] = tuple(one for what in self._quantities for one in what.channels)
        self._space = box_of(self.channels)
        self.observation_space = self._space
        self.metadata = {**self.metadata, "render_fps": max(1, round(1.0 / control_period))}  # type: ignore[misc]
        self.render_mode, self._camera, self._size = render_mode, camera, size
        self._model: Model | None = None  # model of `simulation` before randomisation
        self._places: FreePlaces | None = None
        self._page: EnvironmentPage | None = None
        self._shown = 0.0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: seed that makes this and all later episodes repeatable bit for bit.
            options: "state", a `taichisoft.State` to start from without randomisation; and options of the task.

        Raises:
            SceneError: an option is unknown, or no free place was found for the object.
            StateError: the state belongs to another model, or has a value that is not finite.
        """
        super().reset(seed=seed)
        options = dict(options or {})
        given = options.pop("state", None)
        drawn = {} if given is not None else self._randomisation.draw(self.np_random)
        self._begin(given, drawn)
        self._begin_task(self.simulation.state, options)
        if options:
            raise SceneError(f"options: there is no '{next(iter(options))}'; there are: state, {self._options}")
        seen = self.simulation.observe()
        info = {**self._judge(seen, None).info, "randomised": drawn}
        self._show()
        return self._measure(seen), info

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Simulate one control period.

        An episode is terminated when the task has failed irrecoverably, and truncated when the simulation diverges,
        which is not a failure of the task; info then has "diverged". Actions are clipped to -1 and 1, for the motion
        and for the reward.

        Raises:
            ResetNeeded: no episode has begun.
            SceneError: the action has another number of entries than `action_space`, or a value that is not finite.
        """
        self._refuse_before_reset()
        asked = self._valid_action(action)
        control = self._actuation.control(asked, self.simulation.state, self._period)
        diverged = ""
        try:
            for _ in range(self._steps):
                self.simulation.step(control)
        except SimulationDiverged as error:
            diverged = str(error)
        seen = self.simulation.observe()
        judged = self._judge(seen, asked)
        info = {**judged.info, "diverged": diverged} if diverged else dict(judged.info)
        self._show()
        return self._measure(seen), float(judged.reward), judged.failed, bool(diverged), info

    def render(self) -> np.ndarray | None:  # type: ignore[override]
        """Picture of the present state with a mark at the target, shape (height, width, 3), dtype uint8.

        None unless the render mode is "rgb_array".
        """
        if self.render_mode != "rgb_array":
            return None
        return self.picture(self._camera, self._size, self._marks())

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
        """Close the renderer and the page."""
        if self._model is not None:
            self.simulation.close()
        if self._page is not None:
            self._page.close()
            self._page = None

    @property
    def fingers(self) -> tuple[str, ...]:
        """Names of the soft bodies with anchors."""
        return tuple(name for name, body in self.scene.soft_bodies.items() if body.anchors)

    @property
    def cavities(self) -> tuple[str, ...]:
        """Names of the cavities."""
        return self._actuation.cavities

    @property
    def _options(self) -> str:
        return "target"

    @abstractmethod
    def _observed(self) -> Sequence[ChannelGroup]:
        """Observed quantities, in the order of the channels."""

    @abstractmethod
    def _begin_task(self, start: State, options: dict[str, Any]) -> None:
        """Choose the task of an episode that starts at `start`; removes the options that it uses from `options`."""

    @abstractmethod
    def _judge(self, seen: Observation, action: np.ndarray | None) -> Judgement:
        """Judge the task after a control period with `action`; None at the start of an episode."""

    def _refuse_before_reset(self) -> None:
        if self._model is None:
            raise gymnasium.error.ResetNeeded("no episode has begun: call reset() first")

    @staticmethod
    def _numbers(value: Any) -> np.ndarray:
        """Copy an argument to an array of numbers; a single NaN if it cannot be converted."""
        try:
            given = np.asarray(value)
        except ValueError:  # rows of unequal lengths
            return np.array(np.nan)
        return given.astype(np.float64) if given.dtype.kind in "iuf" else np.array(np.nan)

    def _valid_action(self, action: Any) -> np.ndarray:
        """Copy an action to numbers from -1 to 1, shape (action_count,)."""
        asked = self._numbers(action)
        if asked.shape != self.action_space.shape or not np.isfinite(asked).all():
            raise SceneError(f"action {action!r}: must be {len(self.action_channels)} finite numbers from -1 to 1")
        return np.clip(asked, -1.0, 1.0)

    def _begin(self, given: State | None, drawn: dict[str, float]) -> None:
        """Set the simulation to the start of an episode."""
        from taichisoft.building import Simulation
        from taichisoft_gym.places import FreePlaces
        from taichisoft_gym.prepared import prepared

        model, start = prepared(self._scene_text, SETTLING_TIME)
        if model is not self._model:
            if self._model is not None:
                self.simulation.close()
            self._model, self.simulation = model, Simulation(model)
            self._places = FreePlaces(model, start, self.object) if self._randomisation.place else None
        masses = {self.object: drawn["mass"] * self._mass_of(model)} if "mass" in drawn else {}
        friction = drawn.get("friction")
        self.simulation.change_model(model.varied(friction, masses) if masses or friction is not None else model)
        self.simulation.restore(given if given is not None else self._placed(start, drawn))

    def _placed(self, start: State, drawn: dict[str, float]) -> State:
        """The first state with the drawn variations; a place within another body is drawn again.

        Raises:
            SceneError: no free place was found.
        """
        if "modulus" in drawn:
            start = start.changed(young_modulus=drawn["modulus"] * start.young_modulus)
        if self._places is None:
            return start
        problem = ""
        for _ in range(MOST_PLACES):
            placed = self._shifted(start, drawn)
            problem = self._places.problem(placed)
            if not problem:
                return placed
            drawn |= self._randomisation.draw_place(self.np_random)
        raise SceneError(
            f"randomisation['place'] = {self._randomisation.place:g}: none of {MOST_PLACES} places was free; "
            f"{problem}; take a shorter distance"
        )

    def _shifted(self, start: State, drawn: Mapping[str, float]) -> State:
        """A state with the object at the drawn place."""
        places = start.rigid_position.copy()
        index = list(self.scene.rigid_bodies).index(self.object)
        places[index] += drawn["place right"] * self._axes[0] + drawn["place front"] * self._axes[1]
        return start.changed(rigid_position=places)

    @property
    def object(self) -> str:
        """Name of the rigid body of the task.

        Raises:
            SceneError: the scene has no rigid body.
        """
        if self.scene.main_object is None:
            raise SceneError("this needs a scene with a rigid body; it has none")
        return self.scene.main_object

    def _mass_of(self, model: "Model") -> float:
        return next(body.mass for body in model.rigid_bodies if body.name == self.object)

    def _marks(self) -> np.ndarray:
        """Points marked by `render` [mm], shape (mark_count, 3)."""
        return np.zeros((0, 3))

    def _measure(self, seen: Observation) -> np.ndarray:
        """The observation, with noise."""
        values = np.concatenate([np.asarray(what.read(seen), np.float64) for what in self._quantities])
        if self._noise:
            spread = self._noise * (self._space.high.astype(np.float64) - self._space.low)
            values = values + spread * self.np_random.standard_normal(len(values))
        return saturated(values, self._space)

    def _show(self) -> None:
        """Show the state in a browser, in real time."""
        if self.render_mode != "human":
            return
        if self._page is None:
            from taichisoft_gym.environment_page import EnvironmentPage

            self._page = EnvironmentPage(self.simulation)
        self._page.show(self.simulation)
        time.sleep(max(0.0, self._shown + self._period - time.monotonic()))
        self._shown = time.monotonic()


def _whole_steps(period: float, time_step: float) -> int:
    steps = round(period / time_step)
    if steps < 1 or abs(steps * time_step - period) > 1e-9:
        raise SceneError(f"control_period = {period:g} s: must be a whole multiple of the time step, {time_step:g} s")
    return steps
