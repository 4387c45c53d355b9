"""Time integration, solvers, masses, elasticity and supports of bodies."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize_scalar

from taichisoft.errors import MeshError, SceneError
from taichisoft.mesh import divided_hexahedra
from taichisoft_sofa.components.anchor_targets import MotionTarget, PointsTarget
from taichisoft_sofa.components.draft import DraftAnchor, DraftForces, DraftMaterial, Mass
from taichisoft_sofa.components.graph import TOPOLOGIES, linked_state, nearest, node_of
from taichisoft_sofa.components.joints import hold_joint, weigh_joint
from taichisoft_sofa.components.regular_grids import divided, hexahedra_of
from taichisoft_sofa.components.states import start_position
from taichisoft_sofa.components.typed_values import computed, described, flag, is_given, number, numbers, text
from taichisoft_sofa.tree.component import Component
from taichisoft_sofa.tree.value_kinds import canonical

if TYPE_CHECKING:
    from taichisoft_sofa.components.draft import SceneDraft

# SOFA's energies of hyperelastic materials, the native laws of the same moduli at rest, and how far they differ.
#
# Energies are by volume [kPa], of principal stretches a, b, c. SOFA's are those of its folder hyperelastic/material
# since pull request 4603 of 2024; before, the second parameter of NeoHookean was a bulk modulus, and is Lame's lambda
# now.

STRETCH = 1.3
"""At which the pull of a bar is compared [-]."""
STEP = 1e-4
"""Step of the differences by which the pull is found [-]."""

Energy = Callable[[np.ndarray], float]
"""Energy [kPa] of principal stretches, shape (3,)."""


@dataclass(frozen=True)
class SofaMaterial:
    """A material of SOFA with its native law.

    Attributes:
        law: the native law.
        shear, dilation: Lame's mu and lambda at rest [kPa].
        energy: SOFA's energy.
        coefficients: of the native law, for laws that take them.
    """

    law: str
    shear: float
    dilation: float
    energy: Energy
    coefficients: Mapping[str, float] = field(default_factory=dict)

    @property
    def ratio(self) -> float:
        """Poisson's ratio at rest [-]; NaN without a positive shear modulus."""
        return self.dilation / (2.0 * (self.dilation + self.shear)) if self.shear > 0.0 else np.nan

    def pull_ratio(self) -> float:
        """The pull of a bar that is free at its sides, at STRETCH, in SOFA over that of the native law [-]."""
        return _pull(self.energy) / _pull(self._native)

    def _native(self, stretches: np.ndarray) -> float:
        volume = stretches.prod() - 1.0
        by_volume = 0.5 * self.dilation * volume**2
        first, second = (stretches**2).sum(), (stretches**2).prod() * (stretches**-2).sum()
        by_first, by_second = first - 3.0 - 2.0 * volume + volume**2, second - 3.0 - 4.0 * volume
        if self.law == "hooke":
            strains = stretches - 1.0
            return float(self.shear * (strains**2).sum() + 0.5 * self.dilation * strains.sum() ** 2)
        if self.law == "neo-hookean":
            return float(0.5 * self.shear * by_first + by_volume)
        if self.law == "mooney-rivlin":
            return float(self.coefficients["c10"] * by_first + self.coefficients["c01"] * by_second + by_volume)
        mu, alpha = self.coefficients["mu1"], self.coefficients["alpha1"]
        return float(mu / alpha * ((stretches**alpha).sum() - 3.0) + mu * (0.5 * volume**2 - volume) + by_volume)


def _saint_venant(mu: float, lame: float) -> SofaMaterial:
    def energy(s: np.ndarray) -> float:
        strain = 0.5 * (s**2 - 1.0)
        return float(0.5 * lame * strain.sum() ** 2 + mu * (strain**2).sum())

    return SofaMaterial("hooke", mu, lame, energy)


def _neo_hookean(mu: float, lame: float) -> SofaMaterial:
    def energy(s: np.ndarray) -> float:
        log = np.log(s.prod())
        return float(0.5 * mu * ((s**2).sum() - 3.0) - mu * log + 0.5 * lame * log**2)

    return SofaMaterial("neo-hookean", mu, lame, energy)


def _stable_neo_hookean(mu: float, lame: float) -> SofaMaterial:
    alpha = 1.0 + mu / (lame + mu)
    return SofaMaterial(
        "neo-hookean",
        mu,
        lame,
        lambda s: float(0.5 * (mu * ((s**2).sum() - 3.0) + (lame + mu) * (s.prod() - alpha) ** 2)),
    )


def _mooney_rivlin(c1: float, c2: float, bulk: float) -> SofaMaterial:
    def energy(s: np.ndarray) -> float:
        j, first, second = s.prod(), (s**2).sum(), (s**2).prod() * (s**-2).sum()
        shape = c1 * (first * j ** (-2 / 3) - 3.0) + c2 * (second * j ** (-4 / 3) - 3.0)
        return float(shape + 0.5 * bulk * np.log(j) ** 2)

    shear = 2.0 * (c1 + c2)
    return SofaMaterial("mooney-rivlin", shear, bulk - 2.0 * shear / 3.0, energy, {"c10": c1, "c01": c2})


def _ogden(mu: float, alpha: float, bulk: float) -> SofaMaterial:
    def energy(s: np.ndarray) -> float:
        j = s.prod()
        return float(mu / alpha**2 * (j ** (-alpha / 3) * (s**alpha).sum() - 3.0) + 0.5 * bulk * np.log(j) ** 2)

    if alpha == 0.0:
        return SofaMaterial("ogden", np.nan, np.nan, energy)  # no law: it has no shear modulus
    return SofaMaterial("ogden", 0.5 * mu, bulk - mu / 3.0, energy, {"mu1": mu / alpha, "alpha1": alpha})


MATERIALS: dict[str, tuple[int, Callable[..., SofaMaterial]]] = {
    "StVenantKirchhoff": (2, _saint_venant),
    "NeoHookean": (2, _neo_hookean),
    "StableNeoHookean": (2, _stable_neo_hookean),
    "MooneyRivlin": (3, _mooney_rivlin),
    "Ogden": (3, _ogden),
}
"""Number of parameters of each material of SOFA, and the material made of them."""


def _pull(energy: Energy) -> float:
    """dW/da [kPa] where the sides of a bar are free: the least energy over their stretch."""

    def least(stretch: float) -> float:
        found = minimize_scalar(
            lambda side: energy(np.array([stretch, side, side])), bounds=(0.5, 1.2), options={"xatol": 1e-9}
        )
        return float(found.fun)

    return (least(STRETCH + STEP) - least(STRETCH - STEP)) / (2.0 * STEP)


HELD = 1e12
"""Stiffness for points fixed by a constraint [mN/mm]."""
SPRING = 100.0
"""SOFA's default stiffness of rest shape springs [mN/mm]."""
ENGINES = {"BoxROI", "SphereROI"}
EQUAL = 0.01
"""Difference of two laws that is not worth a line [%]."""
COROTATIONS = {"large": "edges", "qr": "edges", "polar": "polar", "polar2": "polar", "svd": "polar"}


def animation_loop(component: Component, draft: "SceneDraft") -> None:
    """Translate the animation loop: FreeMotionAnimationLoop solves constraints, the default loop does not."""
    draft.free_motion = component.type_name.startswith("FreeMotion")


def time_integration(component: Component, draft: "SceneDraft") -> None:
    """Translate implicit Euler with Rayleigh damping, or equilibrium, for the bodies in its node and below."""
    draft.solvers[id(node_of(component))] = component
    if flag(component, "trapezoidalScheme", False):
        draft.refuse(component, "trapezoidalScheme; only the implicit Euler method is there")


def linear_solver(component: Component, draft: "SceneDraft") -> None:
    """Accept any linear solver: the system is solved directly."""
    draft.linear_solvers[id(node_of(component))] = component


def constraint_correction(component: Component, draft: "SceneDraft") -> None:
    """Translate a constraint correction: contacts and actuators act on bodies with one."""
    draft.corrections[id(node_of(component))] = component


def uniform_mass(component: Component, draft: "SceneDraft") -> None:
    """Translate equal masses of all points, mass and inertia of a rigid body, or inertia of a joint."""
    if (joint := draft.joint_of(component)) is not None:
        weigh_joint(component, joint)
        return
    body = draft.body_of(component)
    if body is None:
        return
    total = number(component, "totalMass", default=1.0)
    each = numbers(component, "vertexMass", "mass")
    if is_given(component, "totalMass") and total == 0.0 and not len(each):
        draft.refuse(component, "totalMass = 0; a body needs a mass above 0")
        return
    total_counts = is_given(component, "totalMass") and total > 0.0
    if len(each) and (each[0] < 0.0 or (each[0] == 0.0 and not total_counts)):
        draft.refuse(component, f"vertexMass = {each[0]:g} must be above 0")
        return
    if len(each) and not total_counts:
        inertia = _inertia(each)
        if len(each) > 1 and inertia is None:
            draft.refuse(
                component, f"vertexMass has {len(each)} numbers; mass, volume and nine of the inertia are known"
            )
        body.mass = Mass(component, each=float(each[0]), inertia=inertia)
    else:
        body.mass = Mass(component, total=total)


def mass_by_volume(component: Component, draft: "SceneDraft") -> None:
    """Translate a mass by volume, which each element distributes to its corners."""
    body = draft.body_of(component)
    if body is None:
        return
    if is_given(component, "totalMass"):
        body.mass = Mass(component, total=number(component, "totalMass", default=1.0), density=0.0)
    else:
        density = numbers(component, "massDensity", default=[1.0])
        if not len(density) or (density != density[0]).any():
            draft.refuse(component, f"massDensity has {len(density)} numbers; a body has one density here")
            return
        body.mass = Mass(component, density=float(density[0]))
    if component.type_name == "MeshMatrixMass" and not flag(component, "lumping", False):
        draft.depart(
            f"{node_of(component).getPathName()}: MeshMatrixMass couples neighbours; here each point has its share"
        )


def _inertia(values: np.ndarray) -> np.ndarray | None:
    """Inertia over mass [mm^2] in "mass volume inertia", with nine or six numbers, or None."""
    if len(values) in (11, 12):
        return values[2:11].reshape(3, 3)
    if len(values) == 10:
        return values[1:].reshape(3, 3)
    if len(values) in (7, 8):
        xx, xy, xz, yy, yz, zz = values[-6:]
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return None


def young_modulus(component: Component, count: int) -> np.ndarray:
    """Young's modulus of each tetrahedron of a force field [kPa], shape (count,).

    Raises:
        SceneError: the data is neither one number nor one per tetrahedron.
    """
    return _of_cells(component, "youngModulus", 5000.0, count)


def _of_cells(component: Component, name: str, default: float, count: int, cells: str = "tetrahedra") -> np.ndarray:
    values = numbers(component, name, default=[default])
    if len(values) not in (1, count):
        raise SceneError(f"{described(component)}: {name} has {len(values)} numbers for {count} {cells}")
    return np.broadcast_to(values, count)


def tetrahedron_elasticity(component: Component, draft: "SceneDraft") -> None:
    """Translate linear corotational elasticity of the tetrahedra of the nearest topology."""
    body = draft.body_of(component)
    if body is None:
        return
    method = text(component, "method", default="large").lower()
    if method not in COROTATIONS:
        draft.refuse(component, f"method '{method}'; valid: {', '.join(COROTATIONS)}")
        return
    tetrahedra = _tetrahedra_of(component, draft)
    count = len(tetrahedra)
    if not count or not draft.has_points(component, tetrahedra, len(body.position)):
        return
    young, poisson = young_modulus(component, count), _of_cells(component, "poissonRatio", 0.45, count)
    body.materials.append(DraftMaterial(component, tetrahedra, young, poisson, COROTATIONS[method]))


def hexahedron_elasticity(component: Component, draft: "SceneDraft") -> None:
    """Translate linear corotational elasticity of the hexahedra of the nearest topology."""
    body = draft.body_of(component)
    if body is None:
        return
    link = text(component, "topology")
    topology = component.linked("topology") if link else nearest(node_of(component), TOPOLOGIES, _has_hexahedra)
    hexahedra = hexahedra_of(topology)[0] if topology is not None else np.zeros((0, 8), dtype=np.int64)
    if not len(hexahedra):
        draft.refuse(component, "finds no hexahedra in a topology of its node or above")
        return
    if not draft.has_points(component, hexahedra, len(body.position)):
        return
    try:
        tetrahedra = divided_hexahedra(body.position, hexahedra, described(component))
    except MeshError as error:
        raise SceneError(str(error)) from error
    young, poisson = (
        np.repeat(_of_cells(component, name, default, len(hexahedra), "hexahedra"), 6)
        for name, default in (("youngModulus", 5000.0), ("poissonRatio", 0.45))
    )
    draft.depart(
        f"{component.getPathName()}: each hexahedron has one change of volume, and turns at each of its Gauss points; "
        "in SOFA it turns on the whole"
    )
    body.materials.append(DraftMaterial(component, tetrahedra, young, poisson, "polar", element="hexahedral"))


def _has_hexahedra(topology: Component) -> bool:
    return len(hexahedra_of(topology)[0]) > 0


def hyperelasticity(component: Component, draft: "SceneDraft") -> None:
    """Translate a law of rubber for the tetrahedra of the nearest topology, by its moduli at rest."""
    body = draft.body_of(component)
    if body is None:
        return
    name, values = text(component, "materialName"), numbers(component, "ParameterSet")
    if name not in MATERIALS:
        draft.refuse(component, f"materialName '{name}'; known are: {', '.join(MATERIALS)}")
        return
    count, make = MATERIALS[name]
    if len(values) != count:
        draft.refuse(component, f"ParameterSet = {values.tolist()}; {name} has {count} parameters")
        return
    made = make(*values.tolist())
    if not -1.0 < made.ratio < 0.5:
        draft.refuse(
            component,
            f"ParameterSet = {values.tolist()} makes a shear modulus of {made.shear:.3g} kPa, and a Poisson's ratio of "
            f"{made.ratio:.3g}",
        )
        return
    tetrahedra = _tetrahedra_of(component, draft)
    if not len(tetrahedra) or not draft.has_points(component, tetrahedra, len(body.position)):
        return
    more = 100.0 * (made.pull_ratio() - 1.0)
    if abs(more) > EQUAL:
        draft.depart(
            f"{component.getPathName()}: {name} is the law '{made.law}' of the same moduli at rest; SOFA's pulls by "
            f"{abs(more):.1f} % {'more' if more > 0.0 else 'less'} where a bar is stretched by 30 %"
        )
    ratio, each = made.ratio, np.ones(len(tetrahedra))
    moduli = (each * 2.0 * (1.0 + ratio) * made.shear, each * ratio)
    body.materials.append(DraftMaterial(component, tetrahedra, *moduli, "polar", made.law, made.coefficients))


def _tetrahedra_of(component: Component, draft: "SceneDraft") -> np.ndarray:
    """Tetrahedra of the nearest topology with tetrahedra or hexahedra, shape (count, 4); without one, it is refused."""
    link = text(component, "topology")
    topology = component.linked("topology") if link else nearest(node_of(component), TOPOLOGIES, _has_tetrahedra)
    tetrahedra = computed(topology, "tetrahedra", 4) if topology is not None else np.zeros((0, 4), dtype=np.int64)
    if not len(tetrahedra):
        with_cells = topology or nearest(node_of(component), TOPOLOGIES, lambda one: len(hexahedra_of(one)[0]) > 0)
        if with_cells is not None:
            tetrahedra = divided(*hexahedra_of(with_cells), alternating=True)
    if not len(tetrahedra):
        draft.refuse(component, "finds no tetrahedra in a topology container of its node or above")
    return tetrahedra


def _has_tetrahedra(topology: Component) -> bool:
    return len(computed(topology, "tetrahedra", 4)) > 0


def rest_shape_springs(component: Component, draft: "SceneDraft") -> None:
    """Translate springs from points, or all of them, to rest positions or others; those of a joint hold its angle."""
    if (joint := draft.joint_of(component)) is not None:
        hold_joint(component, joint)
        return
    body = draft.body_of(component)
    if body is None:
        return
    points = numbers(component, "points", "indices").astype(np.int64)
    if not draft.has_points(component, points, len(body.position)):
        return
    stiffness = numbers(component, "stiffness", default=[SPRING])
    every = np.arange(len(body.position))
    chosen = points if len(points) else every
    if not len(stiffness):
        stiffness = np.array([SPRING])
    # As in SOFA: the first stiffness holds for all points unless there is one per point.
    each = stiffness if len(stiffness) == len(chosen) else np.full(len(chosen), stiffness[0])
    external = _external_points(component, chosen)
    for value in np.unique(each):
        target = None if external is None else replace(external, indices=external.indices[each == value])
        own = DraftAnchor(component, chosen[each == value], float(value), follows_rest=target is None, target=target)
        body.anchors.append(own)
    _note_selection(component, "points", draft)


def _external_points(component: Component, chosen: np.ndarray) -> PointsTarget | None:
    """Points of another mechanical object to which springs lead, or None.

    Raises:
        SceneError: the link leads to no mechanical object, or it has other numbers of points.
    """
    if not text(component, "external_rest_shape"):
        return None
    ((path, target), *_) = component.linked_all("external_rest_shape") or [("", None)]
    state = linked_state(component, path, target)
    count = len(start_position(state))
    indices = numbers(component, "external_points").astype(np.int64)
    if not len(indices):
        indices = chosen if count > int(chosen.max(initial=-1)) and count != len(chosen) else np.arange(len(chosen))
    if len(indices) != len(chosen) or (len(indices) and indices.max() >= count):
        raise SceneError(
            f"{described(component)}: external_points has {len(indices)} points, of {count} in {state.getPathName()}; "
            f"{len(chosen)} are needed"
        )
    return PointsTarget(state, indices)


def constant_forces(component: Component, draft: "SceneDraft") -> None:
    """Translate constant forces on points: one for each, the same for all, or shares of `totalForce`."""
    body = draft.body_of(component)
    if body is None:
        return
    width = 6 if body.rigid else 3
    points = numbers(component, "indices", "points").astype(np.int64)
    points = points if len(points) else np.arange(len(body.position))
    if not draft.has_points(component, points, len(body.position)):
        return
    if is_given(component, "totalForce"):
        each = numbers(component, "totalForce").reshape(-1, width)[:1] / max(len(points), 1)
    elif is_given(component, "forces"):
        each = numbers(component, "forces").reshape(-1, width)
    else:
        each = numbers(component, "force", default=(0.0,) * width).reshape(-1, width)[:1]
    if not len(each):
        draft.refuse(component, "has no force; give force, forces or totalForce")
        return
    # As in SOFA: points beyond the list have its last force.
    forces = each[np.minimum(np.arange(len(points)), len(each) - 1)]
    if forces[:, 3:].any():
        draft.refuse(component, "has a torque on a rigid body; forces alone act on rigid bodies here")
        return
    body.forces.append(DraftForces(component, points, forces[:, :3]))


def prescribed_motion(component: Component, draft: "SceneDraft") -> None:
    """Translate points that are shifted in time from key to key, linearly."""
    body = draft.body_of(component)
    if body is None:
        return
    if body.rigid:
        draft.refuse(component, "moves a rigid body; only points of soft bodies are moved so here")
        return
    points = numbers(component, "indices", default=[0.0]).astype(np.int64)
    times, shifts = numbers(component, "keyTimes"), numbers(component, "movements").reshape(-1, 3)
    if not draft.has_points(component, points, len(body.position)):
        return
    if not len(times) or len(times) != len(shifts) or (np.diff(times) <= 0.0).any():
        draft.refuse(
            component, f"keyTimes has {len(times)} times, movements {len(shifts)}; there must be one for each, rising"
        )
        return
    start = body.position[points]
    if flag(component, "relativeMovements", True) is False:
        shifts = shifts - start[:1]
    target = MotionTarget(start, times, shifts)
    body.anchors.append(DraftAnchor(component, points, HELD, follows_rest=False, target=target))


def fixed_points(component: Component, draft: "SceneDraft") -> None:
    """Translate points fixed along all or some axes."""
    body = draft.body_of(component)
    if body is None:
        return
    fixed = numbers(component, "fixedDirections", default=[1.0, 1.0, 1.0]).astype(bool)
    if body.rigid and len(fixed) == 6:
        if not fixed.all():
            draft.refuse(component, "holds a rigid body along some axes; all of it is held here, or nothing")
            return
        fixed = fixed[:3]
    if len(fixed) != 3:
        draft.refuse(component, f"fixedDirections has {len(fixed)} numbers; three are needed, for x, y and z")
        return
    directions = "".join(np.array(["x", "y", "z"])[fixed])
    all_points = flag(component, "fixAll", False)
    points = numbers(component, "indices", default=[0.0]).astype(np.int64)
    chosen = np.arange(len(body.position)) if all_points else points
    if not draft.has_points(component, chosen, len(body.position)):
        return
    if directions:
        body.anchors.append(DraftAnchor(component, chosen, HELD, follows_rest=False, directions=directions))


def _note_selection(component: "Component", name: str, draft: "SceneDraft") -> None:
    """Record that SOFA repeats a selection whenever rest positions change, and may then hold other points."""
    data = component.findData(name)
    parent = data.getParent() if data is not None else None
    source = parent.owner if parent is not None else None
    if isinstance(source, Component) and canonical(source.type_name) in ENGINES and flag(source, "doUpdate", True):
        draft.depart(
            f"{source.getPathName()}: selects its points once, at the start; SOFA repeats this whenever rest positions "
            "change (doUpdate)"
        )
