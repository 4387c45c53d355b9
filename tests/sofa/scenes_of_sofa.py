"""Small SOFA scenes that tests write and load."""

from collections.abc import Mapping
from pathlib import Path
from textwrap import dedent, indent
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from taichisoft import Simulation, load_scene, make_controller
from taichisoft_sofa.components.known_components import known_types
from taichisoft_sofa.controller.sofa_controller import SofaController
from taichisoft_sofa.loading import SceneTree, load_tree
from taichisoft_sofa.tree import component

known_types()  # of trees that tests build by hand


def written(folder: Path, files: Mapping[str, str]) -> Path:
    """Write texts into files of a folder."""
    for name, text in files.items():
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(dedent(text), encoding="utf-8")
    return folder


def loaded(folder: Path, create: str, before: str = "", files: Mapping[str, str] | None = None) -> SceneTree:
    """The tree of a scene whose createScene has this body from line 3 on, with these files beside it."""
    body = indent(dedent(create).strip("\n"), "    ")
    written(folder, {**(files or {}), "scene.py": f"{dedent(before)}\ndef createScene(root):\n{body}\n"})
    return load_tree(folder / "scene.py")


class Run:
    """A simulation that the controller of a scene steers."""

    def __init__(self, folder: Path, scene: str):
        """Begin with a scene of this text, after BODY."""
        written(folder, {"scene.py": BODY + scene})
        self.scene = load_scene(folder / "scene.py")
        self.controller, self.simulation = make_controller(self.scene), Simulation(self.scene)
        assert isinstance(self.controller, SofaController)
        self.controller.reset(self.simulation.model)
        self.start = self.simulation.state.position.copy()

    def steps(self, count: int) -> np.ndarray:
        """Make steps; returns the positions after them [mm]."""
        for _ in range(count):
            self.simulation.step(self.controller.control(self.simulation.observe()))
        return self.simulation.state.position

    @property
    def root(self) -> Any:
        """The scene's root."""
        return self.controller._tree.root


def only_types(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a test know the types alone that it declares."""
    monkeypatch.setattr(component, "TYPES", {})


def declare(type_name: str, **data: Any) -> None:
    """Make a type known, with these data."""
    module = ModuleType("made")
    vars(module)["translate"] = component.component(type_name, **data)(lambda _component, _draft: None)
    component.register(module)


BODY = """
import numpy as np

def body(root, name="body", mesh="block.vtk", correction=True, **box):
    node = root.addChild(name)
    node.addObject("EulerImplicitSolver", rayleighStiffness=0.1, rayleighMass=0.2)
    node.addObject("SparseLDLSolver")
    node.addObject("MeshVTKLoader", name="loader", filename=mesh, **box)
    node.addObject("MeshTopology", src="@loader", name="container")
    node.addObject("MechanicalObject", name="dofs", template="Vec3")
    node.addObject("UniformMass", totalMass=0.05)
    node.addObject("TetrahedronFEMForceField", youngModulus=500, poissonRatio=0.3, method="large")
    if correction:
        node.addObject("LinearSolverConstraintCorrection")
    return node

def free_motion(root):
    root.addObject("FreeMotionAnimationLoop")
    root.addObject("GenericConstraintSolver", tolerance=1e-7, maxIterations=1000)

def collisions(root, mu=0.3):
    free_motion(root)
    root.addObject("CollisionPipeline")
    root.addObject("BruteForceBroadPhase")
    root.addObject("BVHNarrowPhase")
    root.addObject("CollisionResponse", response="FrictionContactConstraint", responseParams=f"mu={mu}")
    root.addObject("LocalMinDistance", alarmDistance=5, contactDistance=1)

def surface(node, mesh, name="Collision", mapping="BarycentricMapping", **models):
    child = node.addChild(name)
    loader = "MeshOBJLoader" if mesh.endswith(".obj") else "MeshSTLLoader"
    child.addObject(loader, name="loader", filename=mesh)
    child.addObject("MeshTopology", src="@loader")
    child.addObject("MechanicalObject")
    for kind in ("Triangle", "Line", "Point"):
        child.addObject(f"{kind}CollisionModel", **models)
    child.addObject(mapping)
    return child
"""
"""What scenes of tests are made of: functions that build bodies, contact and surfaces."""
