"""Triangulated round bodies roll as the polyhedra that they are: a wheel without a rim, and a ball with corners."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from conftest import Figures
from energy import total_energy
from scenes import CONTACT_DISTANCE, FLOOR, GRAVITY, simulate

from taichisoft import Simulation

RADIUS = 20.0
SPEED = 100.0
TOUCHING = RADIUS + CONTACT_DISTANCE
EDGES = {3: 0.145, 4: 0.0727}
"""Mean edges [rad] of balls that are subdivided so often."""


def on_the_floor(shape: dict[str, Any], step: float, friction: float = 0.6, **motion: Any) -> Simulation:
    """A body of 20 g on a level floor."""
    body = {**shape, "mass": 0.02, "position": [0, 0, TOUCHING], **motion}
    return simulate(
        step=step,
        gravity=(0.0, 0.0, -GRAVITY),
        rigid_bodies={"body": body},
        obstacles={"floor": FLOOR},
        contact={"friction": friction},
    )


def rolling(shape: dict[str, Any], step: float, speed: float = SPEED) -> Simulation:
    """A body whose lowest point is at rest."""
    return on_the_floor(shape, step, velocity=[speed, 0, 0], angular_velocity=[0, speed / RADIUS, 0])


@pytest.fixture
def triangulated(tmp_path: Path) -> Callable[[trimesh.Trimesh], dict[str, Any]]:
    """Writes a surface and returns the table of a body that has it."""

    def write(surface: trimesh.Trimesh) -> dict[str, Any]:
        surface.export(tmp_path / "body.stl")
        return {"surface": str(tmp_path / "body.stl")}

    return write


@pytest.mark.parametrize("step", [0.01, 0.002])
def test_a_triangulated_ball_gains_no_energy(
    triangulated: Callable[..., dict[str, Any]], figures: Figures, step: float
) -> None:
    """Tipping over corners costs energy; 2 % of the energy of motion for points that leave their tangents in a step."""
    simulation = rolling(triangulated(trimesh.creation.icosphere(3, RADIUS)), step)
    motion = 0.7 * simulation.model.rigid_mass[0] * SPEED**2
    start, most = total_energy(simulation), 0.0
    for _ in range(round(1.0 / step)):
        simulation.step()
        most = max(most, total_energy(simulation) - start)
    figures.at_most("gain over the energy of motion", most / motion, 0.02)


def test_a_finer_ball_rolls_farther(triangulated: Callable[..., dict[str, Any]], figures: Figures) -> None:
    """A wheel with corners e apart keeps (cos e + k) / (1 + k) of its spin at each, k = 2/5 for a ball.

    So it loses 5/14 e^2 at each, 5/14 e per radian: in 50 mm, 2.5 rad, 13 % with 642 vertices and half as much with
    edges of half the length. A ball goes over edges, too, and between corners: a third of it either way. What the
    steps lose besides is of first order in h: the law is for the line through steps of 1 and 0.5 ms. The speed is
    that which is left on a corner, where it began.
    """
    for subdivisions, edge in EDGES.items():
        table = triangulated(trimesh.creation.icosphere(subdivisions, RADIUS))
        left = []
        for step in (0.001, 0.0005):
            simulation = rolling(table, step)
            while simulation.state.rigid_position[0, 0] < 50.0:
                simulation.step()
                assert simulation.state.time < 2.0
            raised = simulation.state.rigid_position[0, 2] - TOUCHING
            spin = simulation.state.rigid_angular_velocity[0, 1]
            left.append(np.sqrt((spin * RADIUS) ** 2 + GRAVITY * raised / 0.7) / SPEED)
        law = 5 / 14 * edge * 2.5
        figures.close(f"speed lost by edges of {edge} rad [-]", 1 - (2 * left[1] - left[0]), law, law / 3)


@pytest.mark.parametrize("corners", [24, 48])
def test_a_prism_rolls_like_a_wheel_without_a_rim(
    triangulated: Callable[..., dict[str, Any]], figures: Figures, corners: int
) -> None:
    """McGeer's rimless wheel (Passive dynamic walking, 1990), with n corners 2 a = 2 pi / n apart.

    At each corner the spin falls to (cos 2a + k) / (1 + k) of it, k = I / (m r^2), since moments about the new corner
    are kept; between two it swings over. A step in which two corners touch takes more, of first order in h: so the law
    is met by the line through steps of 1 and 0.5 ms, to 5 % since the second order is 1 + 4 times smaller.
    """
    angle = 2 * np.pi / corners
    surface = trimesh.creation.cylinder(RADIUS, 30.0, sections=corners)
    surface.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    surface.apply_transform(trimesh.transformations.rotation_matrix(angle / 2, [0, 1, 0]))
    table = triangulated(surface)
    share = {}
    for step in (0.001, 0.0005):
        share[step] = _spin_after_a_turn(table, step, angle)
        figures.at_most(f"spin after a turn, of the wheel's, steps of {1e3 * step} ms", share[step], 1.01)
    figures.close("the same with steps of no length", 2 * share[0.0005] - share[0.001], 1.0, 0.05)


def _spin_after_a_turn(table: dict[str, Any], step: float, angle: float) -> float:
    """Spin after a turn of a prism that begins on a face, over that of a wheel without a rim [-]."""
    spin, cosine, sine = 10.0, np.cos(angle / 2), np.sin(angle / 2)
    simulation = on_the_floor(
        table, step, position=[0, 0, RADIUS * cosine + CONTACT_DISTANCE],
        velocity=[spin * RADIUS * cosine, 0, spin * RADIUS * sine], angular_velocity=[0, spin, 0],
    )  # fmt: skip
    inertia = simulation.model.rigid_inertia[0, 1, 1] / (simulation.model.rigid_mass[0] * RADIUS**2)
    turned, passed = 0.0, 0
    while turned < 2 * np.pi:
        simulation.step()
        turned += step * simulation.state.rigid_angular_velocity[0, 1]
        if turned > (passed + 1) * angle:
            spin *= (np.cos(angle) + inertia) / (1 + inertia)
            passed += 1
        assert simulation.state.time < 3.0
    raised = np.cos(turned - passed * angle - angle / 2) - cosine
    slowed = np.sqrt(spin**2 - 2 * GRAVITY / RADIUS / (1 + inertia) * raised)
    return float(simulation.state.rigid_angular_velocity[0, 1] / slowed)
