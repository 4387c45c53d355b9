"""The controller "arm": an arm carries the gripper, and follows a script, keys, or a script until a key is pressed."""

from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator
from scipy.spatial.transform import Rotation

from taichisoft.base import right_of
from taichisoft.contact import Model
from taichisoft.control import Control, Controller, KeyEvent, Observation, Slider
from taichisoft.errors import ControllerFailed, SceneError
from taichisoft.mechanics import Drive
from taichisoft.scene import BASE, Number, Positive, Table, Vector, find_file
from taichisoft_arm.arm_paths import JointPath, PathLimits, joint_path, straight_path, unreachable, within
from taichisoft_arm.kinematics import pose_of, solve, solve_near
from taichisoft_arm.mounted_arm import ArmPlacement, MountedArm, motion_of_base
from taichisoft_controllers.keyboard_controller import FRAME_KEY, KeyboardController, KeyboardSettings, moved
from taichisoft_controllers.script_file import RATES, Interpolation, Script, Step, read_script
from taichisoft_controllers.script_targets import Way
from taichisoft_controllers.scripted_controller import LargestValues, StepController, scaling
from taichisoft_controllers.settings import read_drive

# The steps of an arm's script: what those of the controller "scripted" have, and where the arm goes.

SPEED, TURNING_SPEED = 100.0, 90.0
"""Speed of the tool on its straight way [mm/s], and of its turn [degrees/s], where a move does not give them."""


class Move(Table):
    """Where the tool goes."""

    to: Vector | None = None
    """Place of the tool [mm]; it stays when it is not given."""
    turn: Vector | None = None
    """Rotation vector of the gripper since the start of the run [degrees]; it stays as it is when it is not given."""
    speed: Positive | None = None
    """Largest speed of the tool on a straight way [mm/s]; 100 when it is not given."""
    turning_speed: Positive | None = None
    """Largest turning speed on a straight way [degrees/s]; 90 when it is not given."""
    by: Literal["straight", "joints"] = "straight"
    """Whether the tool goes straight, or every joint does, as fast as the arm can."""

    @model_validator(mode="after")
    def _check_way(self) -> "Move":
        if self.to is None and self.turn is None:
            raise ValueError("needs to or turn")
        if self.by == "joints" and (self.speed is not None or self.turning_speed is not None):
            raise ValueError('speed and turning_speed have no effect beside by = "joints"; give a duration')
        return self


class ArmStep(Step):
    """A step of a script for an arm."""

    move: Move | None = None
    """Where the tool goes: to, turn, speed, turning_speed, by."""
    joints: list[Number] | None = Field(None, min_length=1)
    """Where the joints go, from the root on [degrees], sliding ones in mm: all together, as fast as the arm can."""
    moving: ClassVar[tuple[str, ...]] = ("move", "joints", *(key for key in RATES if not key.startswith("base")))

    @model_validator(mode="before")
    @classmethod
    def _refuse_base(cls, given: Any) -> Any:
        for key in ("base_translation", "base_rotation", "base_speed", "base_turning_speed"):
            if isinstance(given, dict) and key in given:
                raise ValueError(f"{key} has no effect, since an arm carries the base; give move or joints")
        return given

    @model_validator(mode="after")
    def _check_arm(self) -> "ArmStep":
        if self.move is not None and self.joints is not None:
            raise ValueError("move and joints are both given; give one of them")
        if self.move is not None and self.duration is not None:
            for key, speed in self.move:
                if key in ("speed", "turning_speed") and speed is not None:
                    raise ValueError(f"duration and move.{key} are both given; give one of them")
        return self


class ArmScript(Script):
    """A script for an arm, which has steps and no keyframes."""

    keyframes: None = None
    steps: list[ArmStep] | None = Field(None, min_length=1)  # type: ignore[assignment] # steps that have more


class CarriedBase:
    """The base of a gripper that an arm carries: its values are those of the joints, shape (joint_count,).

    Attributes:
        arm: the arm.
        frames: names of the frames of its links.
    """

    def __init__(self, arm: MountedArm, tool: Vector | None, ramp: float):
        """Take the arm, the point of the gripper that `move` brings to places, and the time to full speed [s]."""
        self.arm, self._tool, self._ramp = arm, tool, ramp
        self.frames: Collection[str] = arm.frame_names()

    def reset(self, model: Model) -> None:
        """Take the base's pivot, its speed limits, and the frames of the links from a model."""
        scene = model.scene
        self.pivot = model.base_pivot
        self.tool = self.pivot if self._tool is None else np.array(self._tool)
        speed, turning = scene.limits.base_speed, scene.limits.base_turning_speed
        self.limits = PathLimits(
            self._ramp,
            self.pivot,
            np.inf if speed is None else speed,
            np.inf if turning is None else np.radians(turning),
        )
        self._links = [name for name in self.frames if name in scene.frames]

    def observed(self, observation: Observation) -> np.ndarray:
        """The joints that have brought the base where it is."""
        if not (observation.base_translation.any() or observation.base_rotation.any()):
            return self.arm.start
        motion = motion_of_base(observation.base_translation, observation.base_rotation, self.pivot)
        values = solve(self.arm.chain, self.arm.link_pose(motion), self.arm.start)
        if values is None:
            raise ControllerFailed("the base is where the arm cannot bring it; begin at the start, or with this arm")
        return values

    def reached(self, observation: Observation, values: np.ndarray) -> np.ndarray:
        """The joints as they were asked for: they keep within the scene's limits beforehand."""
        return values

    def way(self, step: Step, start: np.ndarray, smooth: bool) -> Way:
        """The way of a step of a script, with trapezoidal speeds, smooth or not."""
        assert isinstance(step, ArmStep) or not step.moves
        path = joint_path(self.arm, self.limits, start, start)
        if isinstance(step, ArmStep) and step.joints is not None:
            path = joint_path(self.arm, self.limits, start, self._joints(step.joints))
        elif isinstance(step, ArmStep) and step.move is not None:
            path = self._moved(step.move, start, np.inf if step.duration is not None else 1.0)
        moves = isinstance(step, ArmStep) and (step.joints is not None or step.move is not None)
        return within(path, step.duration) if moves and step.duration is not None else path

    def control(self, values: np.ndarray) -> dict[str, Any]:
        """Arguments of the `Control` that moves base and links, and the joints as signals [degrees] or [mm]."""
        asked = self.arm.control(values, self.pivot, self._links)
        joints = zip(self.arm.chain.joints, values.tolist(), strict=True)
        return {**asked, "signals": {joint.name: value * joint.to_user for joint, value in joints}}

    def _joints(self, given: list[float]) -> np.ndarray:
        try:
            return self.arm.values_of(given, "joints")
        except SceneError as error:
            raise ControllerFailed(str(error)) from error

    def _moved(self, move: Move, start: np.ndarray, factor: float) -> JointPath:
        """The way of a move; `factor` on the speeds where it does not give any."""
        now = self.arm.motions(start)[-1]
        turn = now[:3, :3] if move.turn is None else Rotation.from_rotvec(move.turn, degrees=True).as_matrix()
        place = now[:3, :3] @ self.tool + now[:3, 3] if move.to is None else np.array(move.to)
        motion = pose_of(place - turn @ self.tool, turn)
        if move.by == "straight":
            speed, turning = move.speed or factor * SPEED, move.turning_speed or factor * TURNING_SPEED
            return straight_path(self.arm, self.limits, start, motion, self.tool, (speed, float(np.radians(turning))))
        target = solve(self.arm.chain, self.arm.link_pose(motion), start)
        if target is None:
            raise unreachable(place)
        return joint_path(self.arm, self.limits, start, target)


# Jogging an arm: keys move the tool in the axes of the world or of the tool, sliders move joints.

RIGHT, FORWARD, UP = np.eye(3)
MOVES = {"right": RIGHT, "left": -RIGHT, "i": FORWARD, "k": -FORWARD, "up": UP, "down": -UP}
"""Directions of steps along right, forward and up."""
TURNS = {"a": UP, "q": -UP, "d": RIGHT, "e": -RIGHT, "g": FORWARD, "t": -FORWARD}
"""Axes of turns, by the right-hand rule."""
AXES_KEY = "w"
FULL_TURN = 360.0


class ArmKeys(KeyboardController):
    """Jogs an arm, and drives the gripper as the keyboard's controller does.

    In the axes of the world up is against gravity, right as in pictures, and forward the third of them; the axes of the
    tool are the same ones at the start of a run, and turn with the gripper.
    """

    _now: np.ndarray

    def __init__(self, base: CarriedBase, **settings: Any):
        """Take what the arm carries, and the settings of the keyboard's controller."""
        self._base, self._in_tool_axes, self.moved_otherwise = base, False, base.frames
        super().__init__(**settings)

    def reset(self, model: Model) -> None:
        """Begin with the arm as it is at the start."""
        self._in_tool_axes = False
        super().reset(model)
        up = model.scene.up
        right = right_of(up)
        self._world = np.column_stack([right, np.cross(up, right), up])
        self._period = model.scene.time.step * model.scene.steps_per_control
        limits = self._base.limits
        self._limits = replace(
            limits,
            base_speed=min(limits.base_speed, SPEED),
            base_turning_speed=min(limits.base_turning_speed, float(np.radians(TURNING_SPEED))),
        )
        self._go_on_from(self._base.arm.start)

    def follow(self, observation: Observation, joints: np.ndarray) -> None:
        """Be ready to take over: from the actuators as they are seen, and from joints [rad] or [mm]."""
        for name, drive in self._drives.items():
            self.sliders[name] = moved(self.sliders[name], read_drive(drive, observation, name))
        self._go_on_from(joints)

    def uses(self, event: KeyEvent) -> bool:
        """Whether a key or slider changes anything."""
        return event.key in self.sliders if event.value is not None else event.key.lower() in self._used

    def key(self, event: KeyEvent) -> None:
        """Set another goal for the tool, or for a joint; or change what the gripper is asked for."""
        joints = [joint.name for joint in self._base.arm.chain.joints]
        key = event.key.lower()
        if event.value is not None and event.key in joints:
            number = joints.index(event.key)
            goal = self._goal.copy()
            goal[number] = moved(self.sliders[event.key], event.value).value / self._joint(number).to_user
            self._set_goal(goal)
        elif event.value is None and self._frame != BASE:  # jaws and hinges of the gripper
            super().key(event)
        elif event.value is None and key in MOVES:
            self._jog(self._steps.translation_step * MOVES[key], np.zeros(3))
        elif event.value is None and key in TURNS:
            self._jog(np.zeros(3), np.radians(self._steps.turn_step) * TURNS[key])
        elif event.value is None and key == AXES_KEY:
            self._in_tool_axes = not self._in_tool_axes
            self._say("")
        else:
            super().key(event)

    def control(self, observation: Observation) -> Control:
        """The joints on their way to the goal, as fast as the arm and the scene's limits allow."""
        path = joint_path(self._base.arm, self._limits, self._now, self._goal)
        furthest = path.profile.rate * self._period
        self._now = self._goal if furthest >= 1.0 or path.length == 0.0 else path.place(furthest)
        others, arm = super().control(observation), self._base.control(self._now)
        for key in ("frame_translation", "frame_rotation"):
            arm[key] = {**getattr(others, key), **arm.get(key, {})}
        return replace(others, **arm)

    def save(self) -> dict[str, Any]:
        """What the keyboard's controller saves, the joints, their goal, and the axes."""
        arm = {"now": self._now.tolist(), "goal": self._goal.tolist(), "in_tool_axes": self._in_tool_axes}
        return {**super().save(), **arm}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on from there."""
        super().restore(saved)
        self._now, self._in_tool_axes = np.array(saved["now"]), saved["in_tool_axes"]
        self._set_goal(np.array(saved["goal"]))

    def _joint(self, number: int) -> Any:
        return self._base.arm.chain.joints[number]

    def _go_on_from(self, joints: np.ndarray) -> None:
        self._now = joints
        self._set_goal(joints)

    def _set_goal(self, joints: np.ndarray) -> None:
        self._goal = joints
        for joint, value in zip(self._base.arm.chain.joints, joints.tolist(), strict=True):
            factor, unit = joint.to_user, joint.unit
            lowest, highest = max(joint.lowest * factor, -FULL_TURN), min(joint.highest * factor, FULL_TURN)
            if joint.slides:
                lowest, highest = joint.lowest, joint.highest
            self.sliders[joint.name] = moved(Slider(lowest, lowest, highest, 1.0, unit), value * factor)
        self._say("")

    def _jog(self, shift: np.ndarray, turn: np.ndarray) -> None:
        """Move the goal by a way [mm] and a turn about the tool [rad], in the chosen axes, shape (3,) each."""
        arm, tool = self._base.arm, self._base.tool
        motion = arm.motions(self._goal)[-1]
        axes = motion[:3, :3] @ self._world if self._in_tool_axes else self._world
        turned = Rotation.from_rotvec(axes @ turn).as_matrix() @ motion[:3, :3]
        place = motion[:3, :3] @ tool + motion[:3, 3] + axes @ shift
        values = solve_near(arm.chain, arm.link_pose(pose_of(place - turned @ tool, turned)), self._goal)
        if values is None:
            self._say("; the arm does not reach further")
        else:
            self._set_goal(values)

    def _say(self, more: str) -> None:
        moves = f"keys move {self._frame}, " if self._frame != BASE else ""
        axes = "tool" if self._in_tool_axes else "world"
        self.status = f"{self._selected or 'all fingers'} selected, {moves}{axes} axes{more}"

    def _select(self, finger: str | None) -> None:
        super()._select(finger)
        self._say("")

    def _bindings(self) -> dict[str, str]:
        step, turn = f"by {self._steps.translation_step:g} mm", f"by {self._steps.turn_step:g} degrees"
        kept = {key: text for key, text in super()._bindings().items() if key not in (*MOVES, *TURNS)}
        self._used = {*kept, FRAME_KEY, "=", *"0123456789", *MOVES, *TURNS, AXES_KEY}
        return {
            **kept,
            **{key: f"move the tool {key} {step}" for key in ("up", "down", "left", "right")},
            "i": f"move the tool forward {step}",
            "k": f"move the tool back {step}",
            "a": f"turn the tool left {turn}",
            "q": f"turn the tool right {turn}",
            "d e": f"tilt the tool about the axis to the right {turn}",
            "g t": f"tilt the tool about the axis forward {turn}",
            AXES_KEY: "move in the axes of the world, or of the tool",
        }


class ArmSettings(ArmPlacement, LargestValues, KeyboardSettings):  # type: ignore[misc] # tables with keys of drives
    """Settings of the controller "arm"."""

    script: Path | None = None
    """The file, by path or by the name of a shipped one; the arm is jogged by keys when it is not given."""
    interpolation: Interpolation | None = None
    """`"linear"` or `"smooth"`, instead of the script's own; of pressures, pulls and tensions."""
    links: Literal["drawn", "colliding", "none"] = "drawn"
    """Whether the arm's links are bodies of the scene: those of its looks, those that it collides with, or none."""


class ArmController(Controller):
    """Follows its script until a person presses a key or moves a slider that moves something, who then steers.

    Attributes:
        sliders: joints, pressures, pulls and so on, by name.
        status: who steers, and what keys do.
    """

    def __init__(self, settings: ArmSettings):
        """Read the arm and its script."""
        self._base = CarriedBase(MountedArm(settings), settings.tool, settings.ramp)
        self._keys = ArmKeys(self._base, **settings.model_dump(include=set(KeyboardSettings.model_fields)))
        self._script = _read(settings, self._base)
        self.interactive = self._script is None
        self.bindings = self._keys.bindings

    def reset(self, model: Model) -> None:
        """Begin with the first step of the script."""
        self._base.reset(model)
        self._keys.reset(model)
        if self._script is not None:
            self._script.reset(model)
        self.bindings, self.sliders = self._keys.bindings, self._keys.sliders
        self._steered = self._script is None
        self._planned = False
        self._say()

    def key(self, event: KeyEvent) -> None:
        """Leave the script, and do what the key says."""
        if self._keys.uses(event):
            self._steered = True
            self._keys.key(event)
            self._say()

    def control(self, observation: Observation) -> Control:
        """What the script or the keys ask for."""
        if self._script is None or self._steered:
            return self._keys.control(observation)
        if not self._planned:
            self._script.base_stops_at(observation)  # a way that the arm cannot go is found before anything moves
            self._planned = True
        asked = self._script.control(observation)
        self._keys.follow(observation, self._joints(asked))
        return asked

    def save(self) -> dict[str, Any]:
        """Where script and keys are, and who steers."""
        script = self._script.save() if self._script is not None else None
        return {"script": script, "keys": self._keys.save(), "steered": self._steered}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on from there."""
        self._steered = saved["steered"] or self._script is None
        if self._script is not None and saved["script"] is not None:
            self._script.restore(saved["script"])
        self._keys.restore(saved["keys"])
        self._planned = True
        self._say()

    def base_stops_at(self, observation: Observation) -> float | None:
        """The end of the script's last way of the arm; None where a person steers."""
        return None if self._script is None else self._script.base_stops_at(observation)

    def summary(self) -> dict[str, str]:
        """Rows that say when each step of the script was made."""
        return self._script.summary() if self._script is not None else {}

    def _joints(self, asked: Control) -> np.ndarray:
        joints = self._base.arm.chain.joints
        return np.array([asked.signals[joint.name] / joint.to_user for joint in joints])

    def _say(self) -> None:
        self.status = self._keys.status if self._steered else "the script steers; a key or slider of the arm takes over"


def _read(settings: ArmSettings, base: CarriedBase) -> StepController | None:
    """The controller that follows the script, if there is one."""
    if settings.script is None:
        return None
    path = find_file(settings.script, "scripts", (".toml",), error=SceneError)
    content = read_script(path, ArmScript)
    factors: Mapping[Drive, float] = scaling(content, path, dict(settings))
    smooth = (settings.interpolation or content.interpolation) == "smooth"
    return StepController(path, content.steps or (), smooth, factors, base)
