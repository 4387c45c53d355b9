"""Force fields of tetrahedra and hexahedra: linear corotational elasticity, and laws of rubber."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import minimize_scalar

from taichisoft.errors import MeshError, SceneError
from taichisoft.mesh import divided_hexahedra
from taichisoft_sofa.components.draft import DraftMaterial, SceneDraft
from taichisoft_sofa.components.reading import TOPOLOGIES, computed, described, nearest, node_of, topology_of
from taichisoft_sofa.components.topologies import divided, filled, hexahedra_of, stiffness_factors
from taichisoft_sofa.tree.component import Component, component, live, unused
from taichisoft_sofa.tree.value_kinds import FROM_0, LINK, RATIO

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


EQUAL = 0.01
"""Difference of two laws that is not worth a line [%]."""
COROTATIONS = {"small": "none", "none": "none", "large": "edges", "qr": "edges"}
COROTATIONS |= dict.fromkeys(("polar", "polar2", "svd"), "polar")


ELASTICITY = {
    "youngModulus": ((5000.0,), FROM_0),
    "poissonRatio": ((0.45,), RATIO),
    "method": "large",
    "updateStiffness": False,
    "topology": LINK,
}
CHANGING = ELASTICITY | {"youngModulus": live((5000.0,), FROM_0), "updateStiffness": live(False)}
RAYLEIGH = {"rayleighStiffness": unused(0.0), "isCompliance": unused(False)}


@component(
    "TetrahedronFEMForceField",
    **CHANGING,
    **RAYLEIGH,
    localStiffnessFactor=unused(()),
    initialPoints=unused(()),
    plasticMaxThreshold=unused(0.0),
    plasticYieldThreshold=unused(0.0001),
    plasticCreep=unused(0.9),
)
@component("FastTetrahedralCorotationalForceField", "TetrahedralCorotationalFEMForceField", **CHANGING, **RAYLEIGH)
def tetrahedron_elasticity(component: Component, draft: "SceneDraft") -> None:
    """Translate linear corotational elasticity of the tetrahedra of the nearest topology."""
    body = draft.own_body_of(component)
    method = component.read_text("method").lower()
    if method not in COROTATIONS:
        raise component.refused(f"method '{method}'; valid: {', '.join(COROTATIONS)}")
    tetrahedra = _tetrahedra_of(component)
    count = len(tetrahedra)
    draft.check_points(component, tetrahedra, len(body.position))
    young, poisson = (component.read_each(name, count, "tetrahedra") for name in ("youngModulus", "poissonRatio"))
    body.materials.append(DraftMaterial(component, tetrahedra, young, poisson, COROTATIONS[method]))


@component("HexahedronFEMForceField", "ParallelHexahedronFEMForceField", **ELASTICITY)
def hexahedron_elasticity(component: Component, draft: "SceneDraft") -> None:
    """Translate linear corotational elasticity of the hexahedra of the nearest topology."""
    body = draft.own_body_of(component)
    if (method := component.read_text("method").lower()) not in ("large", "polar"):
        raise component.refused(f"method '{method}'; hexahedra turn with the body here: large, polar")
    topology = topology_of(component, fits=_has_hexahedra)
    hexahedra = computed(topology, "hexahedra", 8)
    if topology is None or not len(hexahedra):
        raise component.refused("finds no hexahedra in a topology of its node or above")
    draft.check_points(component, hexahedra, len(body.position))
    try:
        tetrahedra = divided_hexahedra(body.position, hexahedra, described(component))
    except MeshError as error:
        raise SceneError(str(error)) from error
    count = len(hexahedra)
    young, poisson = (component.read_each(name, count, "hexahedra") for name in ("youngModulus", "poissonRatio"))
    young, poisson = np.repeat(young * stiffness_factors(topology, count), 6), np.repeat(poisson, 6)
    draft.depart(
        f"{component.getPathName()}: each hexahedron has one change of volume, and turns at each of its Gauss points; "
        "in SOFA it turns on the whole; mapped points follow one of its tetrahedra, in SOFA all its corners"
    )
    body.materials.append(DraftMaterial(component, tetrahedra, young, poisson, "polar", element="hexahedral"))


WEAK = 1e-12
"""Young's modulus of the elements of a body that springs alone hold [kPa]."""


def add_weak_elements(draft: SceneDraft) -> None:
    """Give bodies that springs alone hold elements without stiffness to speak of: the cells of their topologies, or
    else of their hulls."""
    for springs in draft.springs:
        body = draft.body_of(springs.ends[0])
        if springs.is_inside and not body.materials:
            tetrahedra = _cells_of(springs.component)
            tetrahedra = tetrahedra if len(tetrahedra) else filled(body.position, np.arange(len(body.position)))
            if not len(tetrahedra):
                raise springs.component.refused(
                    "holds points without cells, which fill no volume; give them a topology"
                )
            young = np.full(len(tetrahedra), WEAK)
            body.materials.append(DraftMaterial(springs.component, tetrahedra, young, 0.0 * young, "none"))
            draft.depart(f"{body.node.getPathName()}: its cells have {WEAK:g} kPa beside its springs")


def _has_hexahedra(topology: Component) -> bool:
    return len(hexahedra_of(topology)[0]) > 0


@component(
    "TetrahedronHyperelasticityFEMForceField",
    materialName="",
    ParameterSet=(),
    topology=LINK,
    updateStiffness=False,
    **RAYLEIGH,
    AnisotropyDirections=unused(()),
)
def hyperelasticity(component: Component, draft: "SceneDraft") -> None:
    """Translate a law of rubber for the tetrahedra of the nearest topology, by its moduli at rest."""
    body = draft.own_body_of(component)
    name, values = component.read_text("materialName"), component.read_numbers("ParameterSet")
    if name not in MATERIALS:
        raise component.refused(f"materialName '{name}'; known are: {', '.join(MATERIALS)}")
    count, make = MATERIALS[name]
    if len(values) != count:
        raise component.refused(f"ParameterSet = {values.tolist()}; {name} has {count} parameters")
    made = make(*values.tolist())
    if not -1.0 < made.ratio < 0.5:
        raise component.refused(
            f"ParameterSet = {values.tolist()} makes a shear modulus of {made.shear:.3g} kPa, and a Poisson's ratio of "
            f"{made.ratio:.3g}",
        )
    tetrahedra = _tetrahedra_of(component)
    draft.check_points(component, tetrahedra, len(body.position))
    more = 100.0 * (made.pull_ratio() - 1.0)
    if abs(more) > EQUAL:
        draft.depart(
            f"{component.getPathName()}: {name} is the law '{made.law}' of the same moduli at rest; SOFA's pulls by "
            f"{abs(more):.1f} % {'more' if more > 0.0 else 'less'} where a bar is stretched by 30 %"
        )
    ratio, each = made.ratio, np.ones(len(tetrahedra))
    moduli = (each * 2.0 * (1.0 + ratio) * made.shear, each * ratio)
    body.materials.append(DraftMaterial(component, tetrahedra, *moduli, "polar", made.law, made.coefficients))


def _tetrahedra_of(component: Component) -> np.ndarray:
    """Tetrahedra of the nearest topology with tetrahedra or hexahedra, shape (count, 4); without one, it is refused."""
    if not len(tetrahedra := _cells_of(component)):
        raise component.refused("finds no tetrahedra in a topology container of its node or above")
    return tetrahedra


def _cells_of(component: Component) -> np.ndarray:
    topology = topology_of(component, fits=_has_tetrahedra)
    tetrahedra = computed(topology, "tetrahedra", 4)
    if not len(tetrahedra):
        with_cells = topology or nearest(node_of(component), TOPOLOGIES, _has_hexahedra)
        if with_cells is not None:
            tetrahedra = divided(*hexahedra_of(with_cells), alternating=True)
    return tetrahedra


def _has_tetrahedra(topology: Component) -> bool:
    return len(computed(topology, "tetrahedra", 4)) > 0
