"""A box that is pressed against a wall and must not slide: how fast it creeps here, in MuJoCo and in Drake.

    python -m taichisoft_benchmarks.wall_creep --output docs/friction.md

fills the section "creep" of the page. The box of 10 g and 20 mm is pressed with 300 mN, whose friction holds up to
180 mN; its weight is 98.1 mN. By Coulomb's law it stays where it is. Peers run with their defaults, and with what their
documents recommend against slip; those that are not installed are left out.
"""

import time
from collections.abc import Callable, Iterator

import numpy as np

from taichisoft_benchmarks.errors import PeerMissing
from taichisoft_benchmarks.pages import PageOption, fill_section, heading, row, run_program

MASS, SIDE, PRESS, FRICTION, GRAVITY = 0.01, 20.0, 300.0, 0.6, 9810.0
"""Of the box [kg, mm, mN, -, mm/s^2]."""
STEP, SETTLING, MEASURED = 0.01, 0.5, 2.0
"""Time step, time before and of the measurement [s]; 10 ms is the step of our grasps."""
HEADINGS = ("program", "settings", "creep, um/s", "ms a step, processor time")

Heights = Callable[[], tuple[Callable[[], float], Callable[[], object]]]
"""Gives a function for the box's height [mm] and one that makes a time step."""


def here() -> tuple[Callable[[], float], Callable[[], object]]:
    """taichisoft."""
    from taichisoft import Control, Simulation, scene_from_dict

    scene = scene_from_dict(
        {
            "gravity": [0.0, 0.0, -GRAVITY],
            "time": {"step": STEP, "duration": SETTLING + MEASURED},
            "contact": {"friction": FRICTION},
            "obstacles": {"wall": {"plane": {"normal": [-1.0, 0.0, 0.0], "point": [0.0, 0.0, 0.0]}}},
            "rigid_bodies": {"box": {"box": [SIDE] * 3, "position": [-SIDE / 2 - 1.0, 0.0, 0.0], "mass": MASS}},
            "external_forces": [
                {"body": "box", "force": [PRESS, 0.0, 0.0], "start": 0.0, "duration": SETTLING + MEASURED}
            ],
        }
    )
    simulation = Simulation(scene)
    return lambda: float(simulation.state.rigid_position[0, 2]), lambda: simulation.step(Control())


def mujoco(options: str) -> Heights:
    """MuJoCo, whose units are ours: kg, mm, s, mN."""

    def begin() -> tuple[Callable[[], float], Callable[[], object]]:
        try:
            import mujoco
        except ImportError as error:
            raise PeerMissing("mujoco is not installed; pip install 'taichisoft[peers]'") from error
        half = SIDE / 2
        model = mujoco.MjModel.from_xml_string(
            f"""<mujoco><option timestep="{STEP}" gravity="0 0 -{GRAVITY}" {options}/>
            <default><geom friction="{FRICTION} 0 0" condim="3"/></default>
            <worldbody><geom type="box" size="5 100 100" pos="5 0 0"/>
            <body pos="-{half} 0 0"><freejoint/><geom type="box" size="{half} {half} {half}" mass="{MASS}"/></body>
            </worldbody></mujoco>"""
        )
        data = mujoco.MjData(model)
        data.xfrc_applied[1, 0] = PRESS
        return lambda: float(data.qpos[2]), lambda: mujoco.mj_step(model, data)

    return begin


def drake() -> tuple[Callable[[], float], Callable[[], object]]:
    """Drake's discrete plant in SI units, with hydroelastic contact, since a face touches in one point without it."""
    try:
        from pydrake.common.value import Value
        from pydrake.geometry import (
            AddCompliantHydroelasticProperties,
            AddContactMaterial,
            AddRigidHydroelasticProperties,
            Box,
            ProximityProperties,
        )
        from pydrake.math import RigidTransform
        from pydrake.multibody.math import SpatialForce
        from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction, ExternallyAppliedSpatialForce
        from pydrake.multibody.tree import SpatialInertia, UnitInertia
        from pydrake.systems.analysis import Simulator
        from pydrake.systems.framework import DiagramBuilder
    except ImportError as error:
        raise PeerMissing("drake is not installed; pip install 'taichisoft[peers]'") from error
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=STEP)
    side = SIDE * 1e-3
    wall, skin = ProximityProperties(), ProximityProperties()
    for properties in (wall, skin):
        AddContactMaterial(friction=CoulombFriction(FRICTION, FRICTION), properties=properties)
    AddRigidHydroelasticProperties(1.0, wall)
    AddCompliantHydroelasticProperties(side, 1e6, skin)
    plant.RegisterCollisionGeometry(
        plant.world_body(), RigidTransform([0.05, 0.0, 0.0]), Box(0.1, 1.0, 1.0), "wall", wall
    )
    inertia = SpatialInertia(MASS, [0.0, 0.0, 0.0], UnitInertia.SolidBox(side, side, side))
    box = plant.AddRigidBody("box", inertia)
    plant.RegisterCollisionGeometry(box, RigidTransform(), Box(side, side, side), "box", skin)
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -GRAVITY * 1e-3])
    plant.Finalize()
    plant.SetDefaultFloatingBaseBodyPose(box, RigidTransform([-side / 2, 0.0, 0.0]))
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    push = ExternallyAppliedSpatialForce()
    push.body_index, push.p_BoBq_B = box.index(), np.zeros(3)
    push.F_Bq_W = SpatialForce([0.0, 0.0, 0.0], [PRESS * 1e-3, 0.0, 0.0])
    plant.get_applied_spatial_force_input_port().FixValue(context, Value([push]))
    return (
        lambda: 1e3 * float(plant.EvalBodyPoseInWorld(context, box).translation()[2]),
        lambda: simulator.AdvanceTo(simulator.get_context().get_time() + STEP),
    )


RUNS: tuple[tuple[str, str, Heights], ...] = (
    ("taichisoft", "defaults", here),
    ("MuJoCo", "defaults", mujoco("")),
    ("MuJoCo", "elliptic cones, impratio 10", mujoco('cone="elliptic" impratio="10"')),
    ("MuJoCo", "the same, 10 noslip iterations", mujoco('cone="elliptic" impratio="10" noslip_iterations="10"')),
    ("Drake", "hydroelastic contact, 1 MPa", drake),
)


def creep(begin: Heights) -> tuple[float, float]:
    """Speed at which the box sinks [um/s], and processor time of a step [ms]."""
    height, step = begin()
    for _ in range(round(SETTLING / STEP)):
        step()
    start, began, steps = height(), time.process_time(), round(MEASURED / STEP)
    for _ in range(steps):
        step()
    return 1e3 * (start - height()) / MEASURED, 1e3 * (time.process_time() - began) / steps


def lines() -> Iterator[str]:
    """A row for each program that is installed."""
    yield heading(HEADINGS)
    for program, settings, begin in RUNS:
        try:
            speed, cost = creep(begin)
        except PeerMissing as error:
            yield f"\n{program}: {error}\n"
            continue
        yield row([program, settings, f"{speed:.2g}", f"{cost:.3f}"])


def main(output: PageOption = None) -> None:
    """Measure how fast a box that friction holds against a wall creeps."""
    fill_section(output, "creep", lines())


if __name__ == "__main__":
    run_program(main, "taichisoft_benchmarks.wall_creep")
