"""Soft balls that are pressed on a plane or on each other, against Hertz.

A ball of radius R that approaches a rigid plane by d presses with F = 4/3 E* sqrt(R) d^(3/2), 1/E* = (1 - nu^2) / E;
two equal balls that approach by 2 d in all press alike (Hertz 1882; Johnson, Contact Mechanics, 4.2).

Hertz measures d to a point far away in a half-space. The middle of a ball is not far away: a ball is squeezed by the
same force from the other side, 2 R away, which moves the contact by F (1 + nu) / (4 pi E R) + F (1 - nu^2) / (2 pi E R)
(Boussinesq on the axis; Johnson, 3.19; so in Tatara, J. Eng. Mater. Technol. 113, 1991). That is 5 % of d where
d / R = 2 %, and 8 % at 5 %.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.mesh import VolumeMesh, write_volume_mesh
from taichisoft_meshing.gmsh_session import gmsh_session, obey_size_fields, tetrahedra

if TYPE_CHECKING:  # a simulation brings Taichi
    from taichisoft.running import Simulation

RADIUS = 20.0
"""Radius of the balls [mm]."""
YOUNG_MODULUS, POISSON_RATIO = 100.0, 0.3
"""Of the balls [kPa and -]."""
CONTACT_DISTANCE = 0.02
"""Distance that the surfaces are kept apart [mm]; it is added to the distance of the centres."""
GROWTH = 0.25
"""Growth of the elements for each millimetre from the zone of contact [-]."""
STEP = 0.1
"""Time step [s]: far longer than any vibration, so that each step ends in a state of rest."""
STILL = 1e-4
"""Change of the force in a step, over the force, at which a ball counts as resting."""
MOST_STEPS = 200


@dataclass(frozen=True)
class Pressed:
    """A ball at rest under an approach.

    Attributes:
        approach: radius less the distance of its centre from the plane of contact [mm].
        force: [mN].
        contacts: number of contacts that press.
    """

    approach: float
    force: float
    contacts: int

    @property
    def error_of_half_space(self) -> float:
        """Approach over that of Hertz at this force, less one [-]."""
        return self.approach / hertz_approach(self.force) - 1

    @property
    def error(self) -> float:
        """Approach over that of Hertz with the other side of the ball, at this force, less one [-]."""
        return self.approach / (hertz_approach(self.force) - other_side(self.force)) - 1


def hertz_approach(force: float) -> float:
    """How much nearer a rigid plane comes to a distant point of a half-space with a bump of `RADIUS` [mm]."""
    modulus = YOUNG_MODULUS / (1 - POISSON_RATIO**2)
    return (0.75 * force / (modulus * math.sqrt(RADIUS))) ** (2 / 3)


def other_side(force: float) -> float:
    """How far the same force on the other side of the ball moves the contact towards its middle [mm]."""
    inner = (1 + POISSON_RATIO) / 4 + (1 - POISSON_RATIO**2) / 2
    return force * inner / (math.pi * YOUNG_MODULUS * RADIUS)


def make_half_ball(smallest: float, largest: float = 5.0) -> VolumeMesh:
    """The lower half of a ball about the origin, with elements of size `smallest` [mm] where it is to be touched.

    Raises:
        MeshError: gmsh fails.
    """
    with gmsh_session("a half ball") as gmsh:
        occ, field = gmsh.model.occ, gmsh.model.mesh.field
        occ.addSphere(0.0, 0.0, 0.0, RADIUS, angle1=-math.pi / 2, angle2=0.0)
        pole = occ.addPoint(0.0, 0.0, -RADIUS)
        occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeFromPoints", 0)
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
        distance, growing = field.add("Distance"), field.add("Threshold")
        field.setNumbers(distance, "PointsList", [pole])
        zone = 0.25 * RADIUS  # the radius of the contact under an approach of 6 %
        options = {
            "InField": distance, "SizeMin": smallest, "SizeMax": largest,
            "DistMin": zone, "DistMax": zone + (largest - smallest) / GROWTH,
        }  # fmt: skip
        for option, value in options.items():
            field.setNumber(growing, option, value)
        obey_size_fields(gmsh)
        gmsh.model.mesh.generate(3)
        nodes, elements, _ = tetrahedra(gmsh)
    return VolumeMesh("half ball", nodes, elements).check()


def press(mesh: VolumeMesh, approaches: Sequence[float], two: bool = False) -> list[Pressed]:
    """Move the middle of a ball down until it rests at each approach to a plane, or to the mirrored ball.

    Args:
        mesh: the lower half of a ball; the nodes of its flat side are held.
        approaches: of each ball [mm], rising.
        two: whether it is pressed on a ball instead of on a plane.

    Raises:
        TaichisoftError: the simulation failed, or the ball did not come to rest.
    """
    from taichisoft.running import Simulation

    with TemporaryDirectory(prefix="taichisoft-hertz-") as folder:
        path = Path(folder) / "half-ball.msh"
        write_volume_mesh(mesh, path)
        simulation = Simulation(_scene(str(path), two))
    return [_rest(simulation, approach) for approach in approaches]


def _scene(mesh: str, two: bool) -> Any:
    from taichisoft.scene import scene_from_dict

    gap = CONTACT_DISTANCE / 2 if two else CONTACT_DISTANCE
    ball = {
        "mesh": mesh,
        "element": "linear",
        "density": 1e-6,
        "young_modulus": YOUNG_MODULUS,
        "poisson_ratio": POISSON_RATIO,
        "translation": [0.0, 0.0, RADIUS + gap],
        "anchors": [{"box": [[-RADIUS, -RADIUS, -1e-6], [RADIUS, RADIUS, 1e-6]]}],
    }
    bodies = {"ball": ball}
    if two:
        bodies["other"] = {**ball, "rotation": [180.0, 0.0, 0.0], "translation": [0.0, 0.0, -RADIUS - gap]}
    tables = {
        "gravity": [0.0, 0.0, 0.0],
        "time": {"step": STEP},
        "contact": {"friction": 0.0, "contact_distance": CONTACT_DISTANCE, "alarm_distance": 0.5, "spacing": 0.0},
        "soft_bodies": bodies,
    }
    if not two:
        tables["obstacles"] = {"plane": {"plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}}
    return scene_from_dict(tables)


def _rest(simulation: "Simulation", approach: float) -> Pressed:
    from taichisoft.control import Control
    from taichisoft.errors import TaichisoftError

    model, last = simulation.model, 0.0
    at_rest = model.rest_position[model.anchored_nodes]
    shift = np.zeros((len(at_rest), 3))
    shift[:, 2] = -np.sign(at_rest[:, 2]) * approach
    bodies = np.array([model.body_of_node(node) for node in model.anchored_nodes])
    places = {name: (at_rest + shift)[bodies == name] for name in dict.fromkeys(bodies.tolist())}
    for _ in range(MOST_STEPS):
        report = simulation.step(Control(anchor_positions=places))
        force = sum(report.observation.normal_forces.values())
        if report.converged and abs(force - last) < STILL * force:
            return Pressed(approach, force, sum(report.observation.contact_counts.values()))
        last = force
    raise TaichisoftError(f"a ball that approaches by {approach:g} mm does not rest after {MOST_STEPS} steps")
