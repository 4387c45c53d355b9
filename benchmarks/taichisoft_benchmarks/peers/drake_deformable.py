"""Drake's deformable bodies: corotational tetrahedra, implicit Euler, the contact of its rigid bodies."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.mesh import tetrahedron_volumes
from taichisoft_benchmarks.errors import PeerMissing

if TYPE_CHECKING:
    from taichisoft.contact import Model
    from taichisoft.mechanics import SoftBody

METRE = 1e-3
"""Metres in a millimetre: Drake's tolerances are meant for SI units."""


class DrakePeer:
    """One finger that hangs from its base."""

    does_not = (
        "no pressure: Drake takes forces on deformable bodies as densities per volume only, so the finger hangs under "
        "gravity; one material, without the stiff layer; mass by volume, not even over the nodes"
    )

    def __init__(self, model: "Model"):
        """Set the model up in Drake.

        Raises:
            PeerMissing: drake is not installed, or the scene has rigid bodies.
        """
        try:
            from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
            from pydrake.systems.analysis import Simulator
            from pydrake.systems.framework import DiagramBuilder
        except ImportError as error:
            raise PeerMissing("drake is not installed; pip install 'taichisoft[peers]'") from error
        if len(model.soft_bodies) != 1 or model.rigid_bodies or model.obstacles:
            raise PeerMissing("this comparison with drake is of a single soft body")
        builder = DiagramBuilder()
        self._time_step = model.scene.time.step
        self._plant, _ = AddMultibodyPlantSceneGraph(builder, self._time_step)
        self._plant.mutable_gravity_field().set_gravity_vector(model.gravity * METRE)
        self._body = self._add_body(model.soft_bodies[0])
        self._plant.Finalize()
        diagram = builder.Build()
        self._simulator = Simulator(diagram)
        self._simulator.Initialize()
        self._context = self._plant.GetMyContextFromRoot(self._simulator.get_context())
        self._step = 0

    def _add_body(self, body: "SoftBody") -> Any:
        import meshio
        from pydrake.geometry import GeometryInstance, Mesh, ProximityProperties
        from pydrake.math import RigidTransform
        from pydrake.multibody.fem import DeformableBodyConfig, MaterialModel

        settings = body.settings
        volume = tetrahedron_volumes(body.rest_position, body.elements).sum()
        material = DeformableBodyConfig()
        material.set_youngs_modulus(1e3 * settings.young_moduli[0])
        material.set_poissons_ratio(settings.poisson_ratio)
        material.set_mass_density(float(body.node_mass.sum() / (volume * METRE**3)))
        material.set_mass_damping_coefficient(settings.rayleigh_mass)
        material.set_stiffness_damping_coefficient(settings.rayleigh_stiffness)
        material.set_material_model(MaterialModel.kLinearCorotated)
        deformable = self._plant.mutable_deformable_model()
        with TemporaryDirectory() as folder:
            path = Path(folder) / "finger.vtk"
            mesh = meshio.Mesh(body.rest_position * METRE, [("tetra", body.elements)])
            meshio.write(path, mesh, file_format="vtk42", binary=False)
            geometry = GeometryInstance(RigidTransform(), Mesh(path), body.name)
            geometry.set_proximity_properties(ProximityProperties())
            identity = deformable.RegisterDeformableBody(geometry, material, 1.0)
        anchored = body.rest_position[body.anchored]
        if len(anchored):
            edge = np.array([anchored[:, 0].min() * METRE - 1e-9, 0.0, 0.0])
            deformable.SetWallBoundaryCondition(identity, edge, np.array([-1.0, 0.0, 0.0]))
        return identity

    def positions(self) -> np.ndarray:
        """Positions of the nodes [mm], shape (node_count, 3)."""
        found = self._plant.deformable_model().GetPositions(self._context, self._body)
        return np.asarray(found).T / METRE

    def step(self, force: np.ndarray) -> None:
        """Make one step; the forces are not used, see `does_not`."""
        self._step += 1
        self._simulator.AdvanceTo(self._step * self._time_step)

    def facts(self) -> dict[str, int]:
        """No facts of its own."""
        return {}
