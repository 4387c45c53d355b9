"""The steps of an arm's script: what those of the controller "scripted" have, and where the arm goes."""

from collections.abc import Collection
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator
from scipy.spatial.transform import Rotation

from taichisoft.control import Observation
from taichisoft.errors import ControllerFailed, SceneError
from taichisoft.model import Model
from taichisoft.scenes import Number, Positive, Table, Vector
from taichisoft_arm.arm_paths import JointPath, PathLimits, joint_path, straight_path, unreachable, within
from taichisoft_arm.inverse_kinematics import solve
from taichisoft_arm.kinematic_chain import pose_of
from taichisoft_arm.mounted_arm import MountedArm, motion_of_base
from taichisoft_controllers.scripted.script_file import RATES, Script, Step
from taichisoft_controllers.scripted.script_targets import Way

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
            for key in ("speed", "turning_speed"):
                if getattr(self.move, key) is not None:
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
        """The joints that have brought the base where it is.

        Raises:
            ControllerFailed: the arm cannot reach it, as where another controller moved the base.
        """
        if not (observation.base_translation.any() or observation.base_rotation.any()):
            return self.arm.start
        motion = motion_of_base(observation.base_translation, observation.base_rotation, self.pivot)
        found = solve(self.arm.chain, self.arm.link_pose(motion), self.arm.start)
        if found is None:
            raise ControllerFailed("the base is where the arm cannot bring it; begin at the start, or with this arm")
        return found

    def reached(self, observation: Observation, values: np.ndarray) -> np.ndarray:
        """The joints as they were asked for: they keep within the scene's limits beforehand."""
        return values

    def way(self, step: Step, start: np.ndarray, smooth: bool) -> Way:
        """The way of a step of a script, with trapezoidal speeds, smooth or not.

        Raises:
            ControllerFailed: the arm cannot go it, or not in the step's duration.
        """
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
