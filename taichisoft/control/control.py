"""What a controller asks for."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

Vector = np.ndarray | Sequence[float]


@dataclass(frozen=True)
class Control:
    """What a controller asks for; whatever it does not mention stays as it was asked for last.

    The scene's `[limits]` stand between what is asked for and what happens. Angles are in radians.

    Attributes:
        pressure: pressures [kPa] by cavity name ("finger1.cavity"); a cavity is driven by pressure or by volume.
        volume_growth: volumes over the rest volume [mm^3], by cavity name; the pressure is then a result.
        valve: openings of the valves of air lines, from 1, wholly open to the source, to -1, wholly open to the
            exhaust, by cavity name.
        cable_tension: tensions [mN] by cable name ("finger1.tendon"); a cable is driven by tension or by pull.
        cable_pull: how far cables are pulled in [mm], by cable name; the tension is then a result.
        pull_points: places of pull points [mm], shape (3,), by cable name; where the scene says so, the motion of a
            frame comes on top.
        base_translation: shift of the base, and so of what is anchored to it or follows it, from rest [mm], shape (3,).
        base_rotation: rotation vector of the base about its pivot [rad], shape (3,).
        base_velocity: velocity of the base [mm/s], shape (3,), until something else is asked for; instead of
            base_translation.
        base_angular_velocity: angular velocity of the base about its pivot, in world axes [rad/s], shape (3,); instead
            of base_rotation.
        frame_translation, frame_rotation, frame_velocity, frame_angular_velocity: the same of the scene's frames [mm],
            [rad], [mm/s] and [rad/s], by name, shape (3,) each, in the axes of the frame that carries it as they are at
            rest. A pose is reached at the end of the step, as far as the frame's speeds allow.
        frame_angle: angles of frames with a hinge [rad], by name.
        anchor_positions: positions that the anchors of a soft body hold their nodes to instead of the rest positions
            [mm], by the body's name, shape (anchor_count, 3): a row for each of its anchored nodes, in the order of the
            nodes. The motion of the frame that the body follows comes on top. No limit of the scene holds them back.
        gravity: acceleration of gravity [mm/s^2], shape (3,); what is up in pictures remains so.
        young_modulus: Young's moduli [kPa] by material: a soft body's own ("finger1") or one of its regions'
            ("finger1.regions.0"). Poisson's ratios stay.
        signals: numbers of the controller's own by name, such as a set point, for outputs to record.
    """

    pressure: Mapping[str, float] = field(default_factory=dict)
    volume_growth: Mapping[str, float] = field(default_factory=dict)
    valve: Mapping[str, float] = field(default_factory=dict)
    cable_tension: Mapping[str, float] = field(default_factory=dict)
    cable_pull: Mapping[str, float] = field(default_factory=dict)
    pull_points: Mapping[str, Vector] = field(default_factory=dict)
    base_translation: Vector | None = None
    base_rotation: Vector | None = None
    base_velocity: Vector | None = None
    base_angular_velocity: Vector | None = None
    frame_translation: Mapping[str, Vector] = field(default_factory=dict)
    frame_rotation: Mapping[str, Vector] = field(default_factory=dict)
    frame_velocity: Mapping[str, Vector] = field(default_factory=dict)
    frame_angular_velocity: Mapping[str, Vector] = field(default_factory=dict)
    frame_angle: Mapping[str, float] = field(default_factory=dict)
    anchor_positions: Mapping[str, np.ndarray] = field(default_factory=dict)
    gravity: Vector | None = None
    young_modulus: Mapping[str, float] = field(default_factory=dict)
    signals: Mapping[str, float] = field(default_factory=dict)
