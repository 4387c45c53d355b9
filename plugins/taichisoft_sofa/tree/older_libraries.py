"""Older names of scene libraries, if only their present generation is available.

`stlib` and `splib` provide the functions of `stlib3` and `splib3` for scenes of the older generation: prefabs are
attached to a node, the first argument or `attachedTo`, and rigid bodies have their older components.
"""

import functools
import importlib
import importlib.util
from collections.abc import Callable, Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

from taichisoft_sofa.tree.node import Node
from taichisoft_sofa.tree.prefab import Prefab
from taichisoft_sofa.tree.scene_modules import OurLoader

PRESENT = {"stlib": "stlib3", "splib": "splib3"}
# Order of the arguments of prefabs in the older generation.
ARGUMENTS = {
    "ElasticMaterialObject": (
        "attachedTo",
        "volumeMeshFileName",
        "name",
        "rotation",
        "translation",
        "scale",
        "surfaceMeshFileName",
        "collisionMesh",
        "withConstrain",
        "surfaceColor",
        "poissonRatio",
        "youngModulus",
        "totalMass",
    ),
    "VisualModel": ("parent", "surfaceMeshFileName", "name", "color", "rotation", "translation", "scale"),
}
RIGID_BODIES = ("RigidObject", "Cube", "Floor", "Sphere")


class OlderLibraries(MetaPathFinder, OurLoader):
    """Finds stlib and splib as the last finder."""

    def find_spec(self, name: str, _path: Sequence[str] | None, _target: Any = None) -> ModuleSpec | None:
        """Specification of such a module; None if the present generation has no counterpart."""
        present = present_name(name)
        if present is None or not _exists(present):
            return None
        return ModuleSpec(name, self, is_package=True)

    def exec_module(self, module: ModuleType) -> None:
        """Copy the contents of the module of the present generation."""
        present = importlib.import_module(str(present_name(module.__name__)))
        for name, item in vars(present).items():
            if not name.startswith("__") and not isinstance(item, ModuleType):
                setattr(module, name, _as_before(name, item))


def present_name(name: str) -> str | None:
    """Present name of a module of an older library, or None."""
    library, _, rest = name.partition(".")
    present = PRESENT.get(library)
    return present and (f"{present}.{rest}" if rest else present)


def _exists(name: str) -> bool:
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:
        return False


def _as_before(name: str, item: Any) -> Any:
    if isinstance(item, type) and issubclass(item, Prefab) and name in ARGUMENTS:
        return _attached(item, ARGUMENTS[name])
    return _rigid_body(item) if name in RIGID_BODIES else item


def _attached(prefab: type[Prefab], arguments: Sequence[str]) -> Callable[..., Prefab]:
    """Convert a prefab to a function that attaches it to a node."""

    @functools.wraps(prefab, updated=())
    def made(*given: Any, **named: Any) -> Prefab:
        named |= dict(zip(arguments, given, strict=False))
        named["visualMeshPath"] = named.pop("surfaceMeshFileName", "") if "parent" in arguments else ""
        parent = named.pop(arguments[0], None)
        return prefab(**named, **({"parent": parent} if parent is not None else {}))

    return made


def _rigid_body(make: Callable[..., Node]) -> Callable[..., Node]:
    """Make a rigid body with the older names of its solvers, and with a constraint correction for contacts."""

    @functools.wraps(make)
    def made(*given: Any, **named: Any) -> Node:
        body = make(*given, **named)
        for component, former in (("EulerImplicitSolver", "odesolver"), ("CGLinearSolver", "Solver")):
            solver = body.getObject(component, warning=False)
            if solver is not None:
                solver.setName(former)
        if body.hasObject("Solver") and not body.hasObject("UncoupledConstraintCorrection"):
            body.addObject("UncoupledConstraintCorrection")
        return body

    return made
