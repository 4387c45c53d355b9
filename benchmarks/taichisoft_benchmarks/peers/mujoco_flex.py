"""MuJoCo's flex: soft bodies of tetrahedra in a rigid-body simulator, integrated implicitly since 3.13."""

from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.mesh import linear_parts
from taichisoft_benchmarks.errors import PeerMissing

if TYPE_CHECKING:
    from taichisoft.contact import Model
    from taichisoft.mechanics import SoftBody

NEEDS = "pip install 'taichisoft[peers]'"
PLANE_SIZE = 1000.0
NUMBERS_PER_ELEMENT = 24
"""Length of a tetrahedron's stiffness in MuJoCo: half a matrix of six edges, and three numbers that are zero."""


class MujocoPeer:
    """Our bodies as flexes, boxes and planes; quadratic tetrahedra as eight linear ones each, which it knows alone."""

    does_not = (
        "no air cavity (the pressure comes as forces from outside, which are constant in a step); contact and friction "
        "are regularised, so that a held object creeps; no mass damping; the base does not move. Its solver of "
        "M + h D + h^2 K is iterative and warns when it stops early, which damps the motion: see displacement_mm"
    )

    def __init__(self, model: "Model", iterations: int = 100, tolerance: float = 1e-8):
        """Set the model up in MuJoCo; the defaults are its own.

        Raises:
            PeerMissing: mujoco is not installed or has no implicit flex.
        """
        try:
            import mujoco
        except ImportError as error:
            raise PeerMissing(f"mujoco is not installed; {NEEDS}") from error
        if not hasattr(mujoco.mjtIntegrator, "mjINT_DISCRETE"):
            raise PeerMissing(f"mujoco {mujoco.__version__} has no discrete integrator; {NEEDS}")
        self._mujoco = mujoco
        bodies = [*(_flex(body) for body in model.soft_bodies), *_boxes(model), *_planes(model)]
        scene = model.scene
        document = f"""<mujoco>
            <compiler angle="radian"/>
            <option timestep="{scene.time.step}" gravity="{_numbers(model.gravity)}" integrator="discrete"
                cone="elliptic" iterations="{iterations}" tolerance="{tolerance}"/>
            <size memory="4G"/>
            <default><geom friction="{scene.contact.friction} 0 0" condim="3"/></default>
            <worldbody>{"".join(bodies)}</worldbody>
        </mujoco>"""
        self._model = mujoco.MjModel.from_xml_string(document)
        self._stiffen(model)
        self._data = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, self._data)
        body = self._model.flex_vertbodyid
        free = self._model.body_dofnum[body] == 3
        self._free = np.flatnonzero(free)
        self._dof = self._model.body_dofadr[body[free]][:, None] + np.arange(3)

    def positions(self) -> np.ndarray:
        """Positions of the nodes [mm], shape (node_count, 3)."""
        return np.array(self._data.flexvert_xpos)

    def step(self, force: np.ndarray) -> None:
        """Make one step with these forces on the nodes [mN], shape (node_count, 3).

        Raises:
            PeerMissing: the motion has become unstable, after which MuJoCo restarts from rest.
        """
        self._data.qfrc_applied[self._dof] = force[self._free]
        self._mujoco.mj_step(self._model, self._data)
        if any(self._warned(kind) for kind in ("BADQPOS", "BADQVEL", "BADQACC")):
            raise PeerMissing("mujoco's motion became unstable, after which it restarts from rest")

    def facts(self) -> dict[str, int]:
        """Contacts in the last step, and how often a solve stopped early."""
        return {"contacts": int(self._data.ncon), "unsolved": self._warned("INERTIA")}

    def _warned(self, kind: str) -> int:
        """How often MuJoCo has given a warning."""
        return int(self._data.warning[int(getattr(self._mujoco.mjtWarning, f"mjWARN_{kind}"))].number)

    def _stiffen(self, model: "Model") -> None:
        """Give elements of another Young's modulus their own stiffness: a flex has one for all."""
        for index, body in enumerate(model.soft_bodies):
            first = self._model.flex_stiffnessadr[index]
            element_count = len(linear_parts(body.elements))
            rows = self._model.flex_stiffness[first : first + NUMBERS_PER_ELEMENT * element_count]
            rows = rows.reshape(-1, NUMBERS_PER_ELEMENT)
            shear = body.settings.young_moduli[0] / (2.0 * (1.0 + body.settings.poisson_ratio))
            rows *= np.repeat(body.lame[:, 1] / shear, element_count // len(body.elements))[:, None]


def _flex(body: "SoftBody") -> str:
    """A soft body; its vertices keep half the contact distance around them."""
    settings = body.settings
    pinned = np.flatnonzero(body.anchored)
    pins = f'<pin id="{_numbers(pinned)}"/>' if len(pinned) else ""
    return f"""<flexcomp name="{body.name}" type="direct" dim="3" mass="{body.node_mass.sum()}" radius="0.5"
            point="{_numbers(body.rest_position)}" element="{_numbers(linear_parts(body.elements))}">
        {pins}
        <elasticity young="{settings.young_moduli[0]}" poisson="{settings.poisson_ratio}"
            damping="{settings.rayleigh_stiffness}"/>
        <contact selfcollide="none" condim="3"/>
    </flexcomp>"""


def _boxes(model: "Model") -> list[str]:
    """Rigid boxes, free to move."""
    boxes = []
    for body in model.rigid_bodies:
        size = model.scene.rigid_bodies[body.name].box
        if size is None:
            raise PeerMissing(f"the rigid body '{body.name}' is not a box, the only shape of this comparison")
        boxes.append(
            f'''<body pos="{_numbers(body.start_position)}" quat="{_numbers(body.start_rotation)}"><freejoint/>
                <geom type="box" size="{_numbers(np.array(size) / 2.0)}" mass="{body.mass}"/></body>'''
        )
    return boxes


def _planes(model: "Model") -> list[str]:
    planes = []
    for obstacle in model.scene.obstacles.values():
        if obstacle.plane is None:
            raise PeerMissing("an obstacle is not a plane, the only shape of this comparison")
        point, normal = _numbers(obstacle.plane.point), _numbers(obstacle.plane.normal)
        planes.append(f'<geom type="plane" pos="{point}" zaxis="{normal}" size="{PLANE_SIZE} {PLANE_SIZE} 1"/>')
    return planes


def _numbers(values: Any) -> str:
    return " ".join(f"{value:.10g}" for value in np.ravel(values))
