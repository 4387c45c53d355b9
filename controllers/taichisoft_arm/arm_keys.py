"""Jogging an arm: keys move the tool in the axes of the world or of the tool, sliders move joints."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from taichisoft.bodies import right_of
from taichisoft.control import Control, KeyEvent, Observation, Slider
from taichisoft.model import Model
from taichisoft.scenes import BASE
from taichisoft_arm.arm_paths import joint_path
from taichisoft_arm.arm_script import SPEED, TURNING_SPEED, CarriedBase
from taichisoft_arm.inverse_kinematics import solve_near
from taichisoft_arm.kinematic_chain import pose_of
from taichisoft_controllers.drives import read_drive
from taichisoft_controllers.keyboard.keyboard_controller import FRAME_KEY, KeyboardController, moved

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
        """Take what the arm carries, and the settings of the keyboard's controller.

        Raises:
            SceneError: one of them is not valid.
        """
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

    def _jog(self, way: np.ndarray, turn: np.ndarray) -> None:
        """Move the goal by a way [mm] and a turn about the tool [rad], in the chosen axes, shape (3,) each."""
        arm, tool = self._base.arm, self._base.tool
        motion = arm.motions(self._goal)[-1]
        axes = motion[:3, :3] @ self._world if self._in_tool_axes else self._world
        turned = Rotation.from_rotvec(axes @ turn).as_matrix() @ motion[:3, :3]
        place = motion[:3, :3] @ tool + motion[:3, 3] + axes @ way
        found = solve_near(arm.chain, arm.link_pose(pose_of(place - turned @ tool, turned)), self._goal)
        if found is None:
            self._say("; the arm does not reach further")
        else:
            self._set_goal(found)

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
