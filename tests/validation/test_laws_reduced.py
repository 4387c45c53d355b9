"""Bodies that move by modes: with all modes and all domains they move as full ones do."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blocks import make_block
from conftest import Figures
from energy import total_energy
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as some
from scenes import GRAVITY, silicone, simulate

from taichisoft import (
    Control,
    Observation,
    Simulation,
    State,
    equilibrium,
    gradient,
    scene_from_dict,
    write_volume_mesh,
)
from taichisoft.errors import TaichisoftError
from taichisoft.mechanics import Modes

SIZE = (40.0, 20.0, 20.0)
ROUND_OFF = 1e-9  # [mm], of anchors' springs with 1e12 mN/mm beside an elastic stiffness of 1e4
HELD = [{"box": [[-50, -50, -50], [-19.9, 50, 50]]}]


def chamber(folder: Path, **changes: Any) -> dict[str, Any]:
    """A hollow block held at one side, turned and shifted."""
    path = folder / "chamber.msh"
    write_volume_mesh(make_block((4, 3, 3), SIZE, hollow=True), path)
    placed: dict[str, Any] = {"rotation": (10.0, 20.0, 30.0), "translation": (3.0, 2.0, 1.0)}
    return silicone(str(path), anchors=HELD, cavities={"air": {"group": "cavity"}}, **{**placed, **changes})


def write_modes(
    path: Path, simulation: Simulation, body: int = 0, mode_count: int | None = None, **changes: Any
) -> str:
    """All modes of a body in an odd mix, or the `mode_count` lowest modes of vibration.

    Anchored nodes have modes of their own: mixed with others their springs would leave few digits of these.
    """
    made = simulation.model.soft_bodies[body]
    size, scale = 3 * len(made.node_mass), np.sqrt(np.repeat(made.node_mass, 3))[:, None]
    if mode_count is None:
        mix, held = np.random.default_rng(3).standard_normal((size, size)), np.repeat(made.anchored, 3)
        basis = np.linalg.qr(np.where(held[:, None] == held, mix, 0.0))[0]
    else:
        basis = lowest_modes(simulation, body, mode_count)
    modes = (basis / scale).reshape(-1, 3, basis.shape[1])
    Modes(made.mesh.nodes, modes, fingerprint=made.fingerprint, **changes).write(path)
    return str(path)


def lowest_modes(simulation: Simulation, body: int, count: int) -> np.ndarray:
    """Eigenvectors of the stiffness at rest over the masses, times the roots of these, in the frame of the mesh."""
    model = simulation.model
    made, elasticity = model.soft_bodies[body], model.elasticity
    assert elasticity is not None
    stiffness = np.zeros((3 * model.node_count,) * 2)
    for nodes, slopes, volume, (first, second) in zip(
        elasticity.linear_elements, elasticity.gradient[:, 0], elasticity.volume[:, 0], elasticity.lame, strict=True
    ):
        products = slopes @ slopes.T
        block = first * np.einsum("ai,bj->aibj", slopes, slopes)
        block += second * (np.einsum("aj,bi->aibj", slopes, slopes) + np.einsum("ab,ij->aibj", products, np.eye(3)))
        rows = (3 * nodes[:, None] + np.arange(3)).reshape(-1)
        stiffness[np.ix_(rows, rows)] += volume * block.reshape(12, 12)
    own = slice(3 * made.nodes.start, 3 * made.nodes.stop)
    stiffness = stiffness[own, own]
    turn = np.kron(np.eye(len(made.node_mass)), frame(made.settings.rotation))
    scale = 1.0 / np.sqrt(np.repeat(made.node_mass, 3))
    turned = turn.T @ (stiffness + np.diag(made.anchor_stiffness.reshape(-1))) @ turn
    return np.asarray(np.linalg.eigh(scale[:, None] * turned * scale)[1][:, :count])


def frame(angles: tuple[float, float, float]) -> np.ndarray:
    from taichisoft.base.rotations import rotation_from_degrees

    return rotation_from_degrees(angles)


def with_ball(body: dict[str, Any], **more: Any) -> Simulation:
    """The chamber, onto whose free end a ball falls."""
    ball = {"sphere": {"radius": 6.0}, "mass": 0.01, "position": [22.0, 10.0, 14.0], "velocity": [0.0, 0.0, -300.0]}
    bodies = {"chamber": body, **more.pop("soft_bodies", {})}
    contact = {"contact_distance": 0.5, "alarm_distance": 2.0, "friction": 0.5, "tolerance": 1e-9}
    return simulate(
        gravity=(0.0, 0.0, -GRAVITY),
        soft_bodies=bodies,
        rigid_bodies={"ball": ball},
        contact=contact,
        **more,
    )


def drive(simulation: Simulation, count: int, volume: bool = False) -> list[State]:
    """Air and motions of the base, straight and in a turn; the states after each step."""
    states = []
    for n in range(count):
        asked = {"volume_growth": 40.0 * n} if volume else {"pressure": min(8.0, 1.5 * n)}
        report = simulation.step(
            Control(
                **{key: {"chamber.air": value} for key, value in asked.items()},
                base_translation=np.array([0.2 * n, 0.1 * n, 0.0]),
                base_rotation=np.array([0.0, -0.01 * n, 0.02 * n]),
            )
        )
        assert report.converged
        states.append(simulation.state)
    return states


def largest_difference(some: list[State], others: list[State]) -> float:
    return max(float(np.abs(one.position - two.position).max()) for one, two in zip(some, others, strict=True))


CASES = [
    ("linear", "hooke", False),
    ("linear", "hooke", True),
    ("smoothed", "hooke", False),
    ("smoothed", "neo-hookean", True),
]


@pytest.mark.parametrize(("element", "law", "volume"), CASES)
def test_all_modes_and_domains_are_the_full_body(
    tmp_path: Path, figures: Figures, element: str, law: str, volume: bool
) -> None:
    """A basis of all motions leaves nothing out: the same equations in other unknowns, with contact, friction, air and
    a base that turns."""
    body = chamber(tmp_path, element=element, law=law)
    full = with_ball(body)
    reduced = with_ball({**body, "reduced": write_modes(tmp_path / "all.npz", full)})
    there = drive(full, 12, volume)
    assert any(len(state.contact_impulse) for state in there)
    assert np.abs(there[-1].position - full.model.rest_position).max() > 1.0
    here = drive(reduced, 12, volume)
    assert reduced.report is not None
    # Nothing is left out; laws of rubber are linearised where the base leads, not where the motion does.
    figures.at_most("imbalance [mm]", reduced.report.imbalance["chamber"], 1e-9 if law == "hooke" else 1e-3)
    figures.at_most("difference of a node [mm]", largest_difference(there, here), ROUND_OFF)
    forces = np.array([[state.frame_wrench[0, 0] for state in states] for states in (there, here)])
    figures.at_most(
        "force on the base [of the largest]", np.abs(forces[0] - forces[1]).max() / np.abs(forces).max(), 1e-6
    )
    torques = np.array([[state.frame_wrench[0, 1] for state in states] for states in (there, here)])
    missed = np.abs(torques[0] - torques[1]).max() / np.abs(torques).max()
    figures.at_most("torque on the base [of the largest]", float(missed), 1e-6)


@pytest.mark.parametrize(("element", "law", "volume"), [CASES[0], CASES[3]])
def test_further_linearisations_of_all_modes(
    tmp_path: Path, figures: Figures, element: str, law: str, volume: bool
) -> None:
    """Newton's method in other unknowns: the same linearisations, to the same end, with contact, damping and air."""
    body, time = chamber(tmp_path, element=element, law=law), {"newton": 20, "newton_tolerance": 1e-9}
    full = with_ball(body, time=time)
    reduced = with_ball({**body, "reduced": write_modes(tmp_path / "all.npz", full)}, time=time)
    figures.at_most("difference [mm]", largest_difference(drive(full, 6, volume), drive(reduced, 6, volume)), ROUND_OFF)
    assert full.report is not None and reduced.report is not None
    assert reduced.report.linearisations == full.report.linearisations > 1
    force = full.state.frame_wrench[0, 0]
    missed = np.abs(reduced.state.frame_wrench[0, 0] - force).max() / np.abs(force).max()
    figures.at_most("force on the base [of the largest]", float(missed), 1e-6)
    if law == "hooke":  # the damping of rubber is linearised where the base leads
        figures.at_most("imbalance [mm]", reduced.report.imbalance["chamber"], ROUND_OFF)


def test_equilibria_of_all_modes(tmp_path: Path, figures: Figures) -> None:
    """By `equilibrium` of a dynamic simulation, and by a static step; so is the wrench, in which nothing moves."""
    body = chamber(tmp_path, element="smoothed", law="neo-hookean")
    asked = Control(pressure={"chamber.air": 6.0}, base_rotation=np.array([0.0, 0.1, 0.2]))
    scene: dict[str, Any] = {"gravity": (0.0, 0.0, -GRAVITY), "time": {"newton_tolerance": 1e-9, "dynamics": "static"}}
    full = simulate(soft_bodies={"chamber": body}, **scene)
    modes = write_modes(tmp_path / "all.npz", full)
    reduced = simulate(soft_bodies={"chamber": {**body, "reduced": modes}}, **scene)
    for one in (full, reduced):
        one.step(asked)
    assert np.abs(full.state.position - full.model.rest_position).max() > 1.0
    figures.at_most("difference of a node [mm]", largest_difference([full.state], [reduced.state]), ROUND_OFF)
    wrench = full.state.frame_wrench[0]
    missed = np.abs(reduced.state.frame_wrench[0] - wrench).max(axis=1) / np.abs(wrench).max(axis=1)
    figures.at_most("wrench on the base [of the largest]", float(missed.max()), 1e-6)
    dynamic = simulate(soft_bodies={"chamber": {**body, "reduced": modes}}, gravity=(0.0, 0.0, -GRAVITY))
    found = equilibrium(dynamic, asked)
    figures.at_most("equilibrium [mm]", np.abs(found.state.position - full.state.position).max(), 1e-3)


def test_a_constant_force_acts_on_modes_too(tmp_path: Path, figures: Figures) -> None:
    """On nodes that nothing else loads."""
    body = {**chamber(tmp_path), "forces": [{"box": [[19, -50, -50], [50, 50, 50]], "force": [0.0, 30.0, -200.0]}]}
    full = simulate(soft_bodies={"chamber": body})
    reduced = simulate(soft_bodies={"chamber": {**body, "reduced": write_modes(tmp_path / "all.npz", full)}})
    for _ in range(6):
        full.step()
        reduced.step()
    assert np.abs(full.state.position - full.model.rest_position).max() > 0.1
    figures.at_most("difference of a node [mm]", largest_difference([full.state], [reduced.state]), ROUND_OFF)


def test_all_modes_of_quadratic_elements(tmp_path: Path, figures: Figures) -> None:
    """Domains with ten nodes, four to an element; a solid block under its weight, whose base turns."""
    path = tmp_path / "solid.msh"
    write_volume_mesh(make_block((2, 1, 1), SIZE), path)
    body = silicone(str(path), anchors=HELD, element="quadratic", law="neo-hookean", rotation=(10.0, 20.0, 30.0))
    full = simulate(gravity=(0.0, 0.0, -GRAVITY), soft_bodies={"block": body})
    modes = write_modes(tmp_path / "all.npz", full)
    reduced = simulate(gravity=(0.0, 0.0, -GRAVITY), soft_bodies={"block": {**body, "reduced": modes}})
    for n in range(1, 9):
        control = Control(base_rotation=np.array([0.0, -0.02 * n, 0.03 * n]))
        full.step(control)
        reduced.step(control)
    figures.at_most("difference [mm]", np.abs(full.state.position - reduced.state.position).max(), ROUND_OFF)


def test_the_same_bits_again_and_resumed(tmp_path: Path) -> None:
    """A state has all that a step needs: the amplitudes are those nearest to its positions."""
    body = chamber(tmp_path, element="linear")
    few = {"domain": np.arange(0, 192, 3), "weight": np.full(64, 3.0), "mode_count": 12}
    modes = write_modes(tmp_path / "few.npz", simulate(soft_bodies={"chamber": body}), **few)
    simulation = with_ball({**body, "reduced": modes})
    states = drive(simulation, 10)
    assert len(states[5].contact_impulse)
    states[4].save(tmp_path / "half.npz")
    again = Simulation(simulation.model)
    assert drive(again, 10)[-1] == states[-1]
    again.restore(State.load(tmp_path / "half.npz"))
    repeated = Simulation(simulation.model)
    repeated.restore(states[4])
    for _ in range(3):
        again.step()
        repeated.step()
    assert again.state == repeated.state


def test_a_reduced_body_beside_full_ones(tmp_path: Path, figures: Figures) -> None:
    """One of three bodies by all its modes, the one in the middle; a cable would see no difference either."""
    body = chamber(tmp_path, element="linear")
    others = {
        "left": {**body, "translation": (3.0, -40.0, 1.0)},
        "right": {**body, "translation": (3.0, 50.0, 1.0), "element": "smoothed"},
    }
    full = with_ball(body, soft_bodies=others)
    modes = write_modes(tmp_path / "all.npz", full)
    reduced = with_ball({**body, "reduced": modes}, soft_bodies=others)
    assert [one.modes is not None for one in reduced.model.soft_bodies] == [True, False, False]
    figures.at_most("difference of a node [mm]", largest_difference(drive(full, 8), drive(reduced, 8)), ROUND_OFF)


def test_first_order_dynamics_have_no_velocities_before(tmp_path: Path, figures: Figures) -> None:
    body = {**chamber(tmp_path, element="linear"), "rayleigh_stiffness": 0.0, "density": 1e-4}
    scene: dict[str, Any] = {"time": {"step": 0.01, "dynamics": "overdamped"}}
    full = simulate(soft_bodies={"chamber": body}, **scene)
    modes = write_modes(tmp_path / "all.npz", full)
    reduced = simulate(soft_bodies={"chamber": {**body, "reduced": modes}}, **scene)
    figures.at_most("difference of a node [mm]", largest_difference(drive(full, 8), drive(reduced, 8)), ROUND_OFF)


@pytest.mark.parametrize("carrier", ["base", "hand"])
def test_few_modes_follow_a_frame_exactly(tmp_path: Path, figures: Figures, carrier: str) -> None:
    """Anchored nodes are where the base is, or a frame that rides on it, at any speed and in turns; with no load and no
    inertia left all others are, too."""
    body = chamber(tmp_path, element="linear", rayleigh_mass=50.0, follows=carrier)
    frames = {"frames": {"hand": {"follows": "base"}}}
    full = simulate(soft_bodies={"chamber": body}, **frames)
    reduced = {**body, "reduced": write_modes(tmp_path / "few.npz", full, mode_count=8)}
    simulation = simulate(soft_bodies={"chamber": reduced}, **frames)
    pivot = simulation.model.frames.pivot[["base", "hand"].index(carrier)]
    turn = np.array([0.0, -0.5, 0.8])
    for n in range(1, 11):
        simulation.step(
            Control(frame_rotation={carrier: turn * n / 10}, base_translation=np.array([3.0 * n, 0.0, 0.0]))
        )
        model, state = simulation.model, simulation.state
        placed = frame_of(turn * n / 10) @ (model.rest_position - pivot).T
        placed = placed.T + pivot + [3.0 * n, 0.0, 0.0]
        held = model.anchored_nodes
        figures.at_most("lag of the anchors [mm]", np.abs(state.position - placed)[held].max(), 1e-6)
    for _ in range(150):
        simulation.step()
    figures.at_most("left after a while [mm]", np.abs(simulation.state.position - placed).max(), 1e-4)


def frame_of(vector: np.ndarray) -> np.ndarray:
    from taichisoft.base.rotations import rotation_from_vector

    return rotation_from_vector(vector)


def test_energy_does_not_grow(tmp_path: Path, figures: Figures) -> None:
    """Twelve modes without damping, let go from a bend: implicit Euler's losses only, as of a full body."""
    body = chamber(tmp_path, element="linear", rayleigh_stiffness=0.0)
    full = simulate(soft_bodies={"chamber": body}, step=0.002)
    modes = write_modes(tmp_path / "few.npz", full, mode_count=12)
    simulation = simulate(soft_bodies={"chamber": {**body, "reduced": modes}}, step=0.002)
    for _ in range(30):
        simulation.step(Control(pressure={"chamber.air": 8.0}))
    simulation.step(Control(pressure={"chamber.air": 0.0}))
    measured = Simulation(full.model)

    def energy() -> float:
        measured.state = simulation.state
        return total_energy(measured)

    first = last = energy()
    assert first > 0.1
    for _ in range(150):
        simulation.step()
        now = energy()
        assert now <= last + 1e-9 * first
        last = now
    figures.at_most("energy left [-]", last / first, 0.9)


def test_what_modes_cannot_follow_is_seen_in_the_full_equations(tmp_path: Path) -> None:
    """Lowest modes follow air in the chamber nearly; the dent of a force on few nodes is in none of them, nor is it in
    the residual of the reduced equations, which is 0 in either case."""
    body = chamber(tmp_path, element="linear")
    full = simulate(soft_bodies={"chamber": body})
    modes = write_modes(tmp_path / "few.npz", full, mode_count=40)
    seen = []
    for force in ({}, {"forces": [{"box": [[19, -9, -9], [30, 30, 30]], "force": [-2000.0, 0.0, 0.0]}]}):
        pair = [simulate(soft_bodies={"chamber": {**body, **force, **more}}) for more in ({}, {"reduced": modes})]
        for one in pair:
            one.step(Control(pressure={"chamber.air": 1.0}))
            for _ in range(30):
                one.step()
        there, here = (one.state.position for one in pair)
        assert pair[1].report is not None
        seen.append((np.linalg.norm(here - there, axis=1).max(), pair[1].report.imbalance["chamber"]))
    (little, balanced), (much, unbalanced) = seen
    assert much > 5.0 * little
    assert unbalanced > 3.0 * balanced
    assert 1.0 < much / unbalanced < 50.0  # a length of the order of the error


WEIGHTS = {"state.position": 0.001 * np.arange(3.0), "volumes.chamber.air": 0.01, "friction_forces.chamber|wall": 1e-3}


def seen_by(seen: Observation) -> tuple[float, dict[str, Any]]:
    """An objective with its derivatives."""
    force = seen.friction_forces.get(("chamber", "wall"), 0.0)
    weights = {**WEIGHTS, "state.position": np.broadcast_to(WEIGHTS["state.position"], seen.state.position.shape)}
    values = {"state.position": seen.state.position, "volumes.chamber.air": seen.volumes["chamber.air"]}
    values["friction_forces.chamber|wall"] = force
    return float(sum(np.sum(weights[name] * value) for name, value in values.items())), weights


def pressed(body: dict[str, Any], **time: Any) -> Simulation:
    """The chamber before a wall, askew to its free end, against which its base presses it."""
    along = frame(body["rotation"])
    normal = along @ [-1.0, 0.3, 0.2]
    corner = along @ [20.0, -10.0, -10.0] + body["translation"] - 0.3 * normal
    wall = {"plane": {"point": corner.tolist(), "normal": normal.tolist()}}
    contact = {
        "contact_distance": 0.5,
        "alarm_distance": 2.0,
        "friction": 0.05,
        "tolerance": 1e-11,
        "depth": "velocity",
    }
    tables = {"time": {"step": 0.01, **time}, "soft_bodies": {"chamber": body}, "obstacles": {"wall": wall}}
    return Simulation(scene_from_dict({**tables, "contact": contact}))


def write_fields(path: Path, simulation: Simulation, **changes: Any) -> str:
    """Modes of polynomials of the place, which vanish where the body is held."""
    made = simulation.model.soft_bodies[0]
    share, mass = made.mesh.nodes / SIZE, np.sqrt(made.node_mass)[:, None]
    fields = np.column_stack([np.ones(len(share)), share, share**2, share[:, 0] * share[:, 1]])
    basis = np.linalg.qr(mass * (share[:, :1] + 0.5) * fields)[0] / mass
    modes = np.einsum("nk,ij->nikj", basis, np.eye(3)).reshape(len(share), 3, -1)
    Modes(made.mesh.nodes, modes, fingerprint=made.fingerprint, **changes).write(path)
    return str(path)


@settings(
    max_examples=6, deadline=None, phases=[Phase.generate], suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(volume=some.booleans(), rubber=some.booleans(), seed=some.integers(0, 1000))
def test_gradient_of_a_reduced_body_agrees_with_differences(
    volume: bool, rubber: bool, seed: int, tmp_path_factory: pytest.TempPathFactory, figures: Figures
) -> None:
    """By air, start, stiffness and damping at once, by few modes and domains, pressed against a wall and slid along.

    A single linearisation leaves out negative stiffness, where rubber has kinks.
    """
    random, folder = np.random.default_rng(seed), tmp_path_factory.getbasetemp()
    law: dict[str, Any] = {"law": "yeoh", "young_modulus": None, "coefficients": {"c10": 30.0, "c20": 2.0}}
    body = chamber(folder, rayleigh_stiffness=0.01, rayleigh_mass=0.4, **(law if rubber else {}))
    full = pressed(body)
    count = len(full.model.soft_bodies[0].mesh_domains.element)
    chosen = np.sort(random.choice(count, count // 3, replace=False)).astype(np.int32)
    weight = 2.5 + random.random(len(chosen))
    body["reduced"] = write_fields(folder / "some.npz", full, domain=chosen, weight=weight)
    simulation, drive, steps = pressed(body), "volume_growth" if volume else "pressure", range(4)

    def controls(half: float) -> list[Control]:
        amounts = [(40.0 if volume else 4.0) + 0.5 * n + half * np.cos(n) for n in steps]
        moves = [frame(body["rotation"]) @ [0.8, 0.2 * n, 0.1 * n] for n in steps]
        return [
            Control(**{drive: {"chamber.air": amount}}, base_translation=move)  # type: ignore[arg-type]
            for amount, move in zip(amounts, moves, strict=True)
        ]

    for control in controls(0.0):
        simulation.step(control)
    start, values = simulation.state, {"rayleigh_stiffness": 0.01, "rayleigh_mass": 0.4}
    names = [f"{drive}.chamber.air", "start.position", "start.velocity", "young_modulus.chamber", "friction"]
    found = gradient(simulation, controls(0.0), seen_by, [*names, *(f"{key}.chamber" for key in values)])
    assert found["friction"] != 0.0
    assume(found.edge_share == found.inexact_share == 0.0)
    moved, pushed = 0.01 * random.standard_normal((2, *start.position.shape))
    slope = float(found[names[0]] @ np.cos(steps)) + float(found[names[3]] * start.young_modulus[0])
    slope += float((found["start.position"] * moved + found["start.velocity"] * pushed).sum())
    slope += sum(float(found[f"{key}.chamber"]) * value for key, value in values.items())
    sides = []
    for half in (1e-4, -1e-4):
        other = pressed(body | {key: value * (1.0 + half) for key, value in values.items()})
        place, speed = start.position + half * moved, start.velocity + half * pushed
        modulus = start.young_modulus * (1.0 + half)
        other.restore(start.changed(position=place, velocity=speed, young_modulus=modulus))
        sides.append(sum(seen_by(other.step(control).observation)[0] for control in controls(half)))
    error = abs(slope / ((sides[0] - sides[1]) / 2e-4) - 1.0)
    figures.at_most("gradient of a reduced body", error, 1e-4 if rubber else 1e-6)


@pytest.mark.parametrize("name", ["base_translation.x", "density.chamber", "rest.size"])
def test_what_modes_depend_on_has_no_gradient(name: str, tmp_path: Path) -> None:
    """Modes are of their masses, and move with the frame that they follow."""
    full = pressed(chamber(tmp_path))
    body = chamber(tmp_path, reduced=write_fields(tmp_path / "some.npz", full))
    moves = {"size": full.model.rest_position}
    with pytest.raises(TaichisoftError, match="reduced bodies"):
        gradient(pressed(body), [None], seen_by, [name], moves)
    with pytest.raises(TaichisoftError, match=r"reduced bodies and time\.newton = 5; leave one"):
        gradient(pressed(body, newton=5), [None], seen_by, [])
