"""Other programs that can do part of the job, each with what it leaves out; taichisoft needs none of them."""

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from itertools import count
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import splu

from taichisoft import Scene
from taichisoft.mesh import linear_parts
from taichisoft_benchmarks.errors import PeerMissing

if TYPE_CHECKING:
    from taichisoft.contact import Model
    from taichisoft.mechanics import SoftBody


class Peer(Protocol):
    """Another program, set up with a model of ours; node arrays are in the order of the model's soft nodes."""

    does_not: str
    """Parts of the job that the program leaves out."""

    def positions(self) -> np.ndarray:
        """Positions of the nodes [mm], shape (node_count, 3)."""

    def step(self, force: np.ndarray) -> None:
        """One time step of the scene with these forces on the nodes [mN], shape (node_count, 3)."""

    def facts(self) -> dict[str, int]:
        """Properties of the run at its end."""


def set_up_peer(scene: Scene, name: str) -> tuple["Model", Peer]:
    """The model of a scene, and another program set up with it."""
    from taichisoft.running import make_model

    model = make_model(scene)
    return model, PEERS[name](model)


def controlled_peer_step(scene: Scene, model: "Model", peer: Peer) -> Callable[[], float]:
    """A function that makes one step under the pressures of the scene's script and returns its time [s].

    The pressure acts as forces on the nodes; the time to compute these is not counted.
    """
    from taichisoft.running import Simulation, make_controller

    observation = Simulation(model).observe()  # at the start: the scripts look at the time only
    controller = make_controller(scene)
    controller.reset(model)
    numbers = count()

    def step() -> float:
        number = next(numbers)
        control = controller.control(replace(observation, step=number, time=number * scene.time.step))
        force = pressure_forces(model, peer.positions(), control.pressure)
        begun = time.perf_counter()
        peer.step(force)
        return time.perf_counter() - begun

    return step


def pressure_forces(model: "Model", position: np.ndarray, pressure: Mapping[str, float]) -> np.ndarray:
    """Forces of the air on the nodes [mN], shape (node_count, 3).

    Args:
        model: model with the walls of the cavities.
        position: positions of the nodes [mm], shape (node_count, 3).
        pressure: pressure [kPa] by cavity name.
    """
    from taichisoft.mechanics import ActuatorGeometry

    actuators, start = model.actuators, model.initial_state()
    geometry = ActuatorGeometry(actuators, model.node_count)
    geometry.update(start.changed(position=position.copy()), model.placed_pull_points(start))
    loss = np.zeros(actuators.count - len(actuators.names))
    effort = actuators.joined(np.array([pressure.get(name, 0.0) for name in actuators.names]), loss)
    by_entry = np.repeat(effort, np.diff(actuators.coordinates.entry_start))
    force = np.zeros((model.node_count, 3))
    np.add.at(force, actuators.coordinates.entry_node, by_entry[:, None] * geometry.gradient.soft)
    return force


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
        """Set the model up in MuJoCo; the defaults are its own."""
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
        """Make one step with these forces on the nodes [mN], shape (node_count, 3)."""
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


SUPERNODAL = 2


def prepare_cholmod(matrix: sparse.csc_matrix) -> Callable[[], Any]:
    """CHOLMOD through cvxopt's wheel: supernodal Cholesky on BLAS, the yardstick of our own factorisation.

    Its supernodal part is under the GPL: taichisoft is compared with it and does not use it.

    Returns:
        A function that factorises, with the pattern analysed once, and returns cvxopt's factor.
    """
    try:
        from cvxopt import cholmod, spmatrix
    except ImportError as error:
        raise PeerMissing("cvxopt is not installed; pip install 'taichisoft[peers]'") from error
    lower = sparse.tril(matrix).tocoo()
    system = spmatrix(lower.data, lower.row.astype(np.int64), lower.col.astype(np.int64), matrix.shape)
    cholmod.options["supernodal"] = SUPERNODAL
    factor = cholmod.symbolic(system)

    def factorise() -> Any:
        cholmod.numeric(system, factor)
        return factor

    return factorise


def prepare_superlu(matrix: sparse.csc_matrix) -> Callable[[], Any]:
    """SuperLU through scipy: an LU, with twice the arithmetic and a choice of pivots.

    Returns:
        A function that factorises in symmetric mode, and analyses the pattern each time: scipy cannot keep it.
    """
    return lambda: splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


PEERS: dict[str, Callable[..., Peer]] = {
    "mujoco": MujocoPeer,
    "mujoco_1000": partial(MujocoPeer, iterations=1000, tolerance=1e-12),
}
"""The other programs by the names that cases give them; the first of MuJoCo's has its own defaults."""
