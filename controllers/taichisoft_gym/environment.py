"""What all environments have in common: a scene, actions, observations, episodes that can be repeated, pictures."""

import time
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import gymnasium
import numpy as np

from taichisoft.building.scene_files import load_scene
from taichisoft.control.observation import Observation
from taichisoft.errors import SceneError, SimulationDiverged
from taichisoft.scenes.file import scene_to_toml
from taichisoft.scenes.scene import Scene
from taichisoft.state import State
from taichisoft_gym import pressures
from taichisoft_gym.actuation import Actuation, Travel, scene_axes
from taichisoft_gym.channels import Channel, Quantity, box_of, saturated
from taichisoft_gym.randomisation import Randomisation
from taichisoft_gym.task import Judgement, changed_scene

if TYPE_CHECKING:  # these bring Taichi, which must not start where an environment only tells its spaces
    from taichisoft.building.simulation import Simulation
    from taichisoft.model import Model
    from taichisoft_gym.page import Page
    from taichisoft_gym.places import FreePlaces

SETTLING_TIME = 0.3
"""Time before an episode in which the object comes to rest on the floor, and the fingers hang [s]."""
MOST_PLACES = 100
"""How many places of the object are drawn before it is clear that hardly any is free."""


class SoftRobotEnvironment(gymnasium.Env[np.ndarray, np.ndarray]):
    """Base of the environments; a task says what is observed and how well it goes.

    The simulator starts at the first `reset`, so that a process which only asks for spaces may still fork.

    Attributes:
        scene: scene that is simulated, with what the arguments change.
        channels: meaning of each number of an observation.
        action_channels: what -1 and 1 of each number of an action stand for.
        simulation: simulation of all episodes; what is drawn anew changes its state and its model.
        usual_pressure: pressures that -1 and 1 stand for where no argument says it [kPa].
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
        """Read the scene. All arguments but the first are those of every environment, beside the task's own.

        Args:
            travel: how far the base can go; None where it stands still.
            scene: scene, or its name or path.
            object: keys of the scene's object that differ, such as {"mass": 0.01} or another shape.
            friction: Coulomb's coefficient [-] instead of the scene's.
            pressure: pressures that -1 and 1 stand for [kPa], none beyond a limit of the scene or of a cavity; when it
                is not given, `usual_pressure` as far as these allow.
            pressure_rate: fastest change of a pressure [kPa/s]; when it is not given 300, or the scene's if lower.
            noise: standard deviation of what is observed, in parts of each channel's range [-].
            randomisation: ranges from which every reset draws, see `Randomisation`.
            control_period: time between two actions [s].
            render_mode: "rgb_array", or "human" for a page in the browser.
            camera: where pictures are taken from, see `Simulation.render`.
            size: width and height of pictures [pixels].

        Raises:
            SceneError: the scene or an argument is not valid.
        """
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise SceneError(f"render_mode = {render_mode!r}: must be one of {self.metadata['render_modes']}, or None")
        read = scene if isinstance(scene, Scene) else load_scene(scene)
        between = pressures.pressure_range(read, pressure, self.usual_pressure)
        self.scene = changed_scene(read, object, friction, between, pressures.pressure_rate(read, pressure_rate))
        self._scene_text = scene_to_toml(self.scene)
        self._axes = scene_axes(self.scene)
        self._steps = _whole_steps(control_period, self.scene.time.step)
        self._period = control_period
        self._noise = noise
        self._randomisation = Randomisation.of(randomisation)
        self._actuation = Actuation(self.scene, between, travel)
        self.action_channels = self._actuation.channels
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (len(self.action_channels),), np.float32)
        self._quantities = self._observed()
        self.channels: tuple[Channel, ...] = tuple(one for what in self._quantities for one in what.channels)
        self._space = box_of(self.channels)
        self.observation_space = self._space
        self.metadata = {**self.metadata, "render_fps": max(1, round(1.0 / control_period))}  # type: ignore[misc]
        self.render_mode, self._camera, self._size = render_mode, camera, size
        self._model: Model | None = None  # that of `simulation`, before anything is drawn
        self._places: FreePlaces | None = None
        self._page: Page | None = None
        self._shown = 0.0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: makes this episode and those after it repeatable to the bit.
            options: "state", a `taichisoft.State` to begin at instead, which is then not randomised; and those of the
                task.

        Raises:
            SceneError: an option is unknown; or hardly any place of the object is free of other bodies.
            StateError: the state belongs to another model, or has a value that is not a finite number.
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
        told = {**self._judge(seen, None).told, "randomised": drawn}
        self._show()
        return self._measure(seen), told

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Simulate one control period.

        An episode is terminated when the task has failed for good, and truncated when the simulation diverges, which
        says nothing of the task; info has "diverged" then. Numbers of the action beyond -1 and 1 count as these ends,
        for the motion and for the reward.

        Raises:
            ResetNeeded: no episode has begun.
            SceneError: the action is not as many finite numbers as `action_space` has.
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
        told = {**judged.told, "diverged": diverged} if diverged else dict(judged.told)
        self._show()
        return self._measure(seen), float(judged.reward), judged.failed, bool(diverged), told

    def render(self) -> np.ndarray | None:  # type: ignore[override]
        """The picture of the present state with a mark at the target, shape (height, width, 3), dtype uint8.

        None in a browser.
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
        """A picture of the present state, as `Simulation.render` describes it.

        Raises:
            ResetNeeded: no episode has begun.
        """
        self._refuse_before_reset()
        return self.simulation.render(camera, size, marks=marks)

    def close(self) -> None:
        """End the renderer and the page."""
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
    def _observed(self) -> Sequence[Quantity]:
        """What is observed."""

    @abstractmethod
    def _begin_task(self, start: State, options: dict[str, Any]) -> None:
        """Choose what is to be done from a state; takes what it knows out of `options`."""

    @abstractmethod
    def _judge(self, seen: Observation, action: np.ndarray | None) -> Judgement:
        """How well it goes after a control period with an action; None at the beginning of an episode."""

    def _refuse_before_reset(self) -> None:
        if self._model is None:
            raise gymnasium.error.ResetNeeded("no episode has begun: call reset() first")

    @staticmethod
    def _numbers(value: Any) -> np.ndarray:
        """An argument as numbers of nobody else's; NaN alone where it is something else."""
        try:
            given = np.asarray(value)
        except ValueError:  # rows of unequal lengths
            return np.array(np.nan)
        return given.astype(np.float64) if given.dtype.kind in "iuf" else np.array(np.nan)

    def _valid_action(self, action: Any) -> np.ndarray:
        """An action as numbers from -1 to 1, shape (action_count,), which nobody else changes."""
        asked = self._numbers(action)
        if asked.shape != self.action_space.shape or not np.isfinite(asked).all():
            raise SceneError(f"action {action!r}: must be {len(self.action_channels)} finite numbers from -1 to 1")
        return np.clip(asked, -1.0, 1.0)

    def _begin(self, given: State | None, drawn: dict[str, float]) -> None:
        """Put the simulation at the start of an episode."""
        from taichisoft.building.simulation import Simulation
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
        """The first state with what was drawn; a place within another body is drawn again.

        Raises:
            SceneError: hardly any place is free.
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
        """A state with the object at the place that was drawn."""
        places = start.rigid_position.copy()
        index = list(self.scene.rigid_bodies).index(self.object)
        places[index] += drawn["place right"] * self._axes[0] + drawn["place front"] * self._axes[1]
        return start.changed(rigid_position=places)

    @property
    def object(self) -> str:
        """Name of the rigid body that the task is about.

        Raises:
            SceneError: there is none.
        """
        if self.scene.main_object is None:
            raise SceneError("this needs a scene with a rigid body; it has none")
        return self.scene.main_object

    def _mass_of(self, model: "Model") -> float:
        return next(body.mass for body in model.rigid_bodies if body.name == self.object)

    def _marks(self) -> np.ndarray:
        """Points that `render` marks [mm], shape (mark_count, 3)."""
        return np.zeros((0, 3))

    def _measure(self, seen: Observation) -> np.ndarray:
        """The observation, with noise."""
        values = np.concatenate([np.asarray(what.read(seen), np.float64) for what in self._quantities])
        if self._noise:
            spread = self._noise * (self._space.high.astype(np.float64) - self._space.low)
            values = values + spread * self.np_random.standard_normal(len(values))
        return saturated(values, self._space)

    def _show(self) -> None:
        """Show the state in a browser, at the pace of real time."""
        if self.render_mode != "human":
            return
        if self._page is None:
            from taichisoft_gym.page import Page

            self._page = Page(self.simulation)
        self._page.show(self.simulation)
        time.sleep(max(0.0, self._shown + self._period - time.monotonic()))
        self._shown = time.monotonic()


def _whole_steps(period: float, time_step: float) -> int:
    steps = round(period / time_step)
    if steps < 1 or abs(steps * time_step - period) > 1e-9:
        raise SceneError(f"control_period = {period:g} s: must be a whole multiple of the time step, {time_step:g} s")
    return steps
