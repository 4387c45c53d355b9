"""Changes of Young's moduli by a scene's controllers, which take effect at `reinit()`, as in SOFA."""

from dataclasses import replace

import numpy as np

from taichisoft.errors import SceneError
from taichisoft_sofa.components.draft import DraftMaterial
from taichisoft_sofa.components.dynamics import young_modulus
from taichisoft_sofa.components.reading import described, flag
from taichisoft_sofa.translation.parts import SoftPart
from taichisoft_sofa.translation.soft_bodies import add_moduli

ROUND_OFF = 1e-9
"""Largest difference of equal Young's moduli, relative, and of equal Poisson's ratios [-]."""


class PartStiffness:
    """The force fields of a soft body, whose sum gives the moduli of its native materials."""

    def __init__(self, name: str, part: SoftPart):
        """Store the initial stiffness of the scene.

        Args:
            name: the body's native name.
            part: the body.
        """
        regions = range(part.material.max(initial=0))
        self._names = [name, *(f"{name}.regions.{index}" for index in regions)]
        self._tetrahedra = part.points[part.elements]
        self._material = part.material
        # One element represents its material.
        self._first = np.array([np.argmax(part.material == number) for number in range(len(self._names))])
        self._fields = tuple(part.body.materials)
        self._young, self._poisson = add_moduli(self._tetrahedra, self._fields)

    def begin(self) -> None:
        """Take the requests up to now as the initial state of the scene."""
        for field in self._fields:
            field.component.reinit_requested = False

    def take(self) -> dict[str, float]:
        """The moduli [kPa] that have changed since the last call, by native material.

        Raises:
            SceneError: no modulus of a native material is equivalent to the force fields.
        """
        fields = tuple(map(_present, self._fields))
        changed = [new for new, old in zip(fields, self._fields, strict=True) if new is not old]
        if not changed:
            return {}
        young, poisson = add_moduli(self._tetrahedra, fields)
        where = described(changed[0].component)
        if np.abs(poisson - self._poisson).max() > ROUND_OFF:
            raise SceneError(
                f"{where}: its new youngModulus changes Poisson's ratio where force fields of other ratios overlap; "
                "give all of them the same poissonRatio"
            )
        if (np.abs(young - young[self._first][self._material]) > ROUND_OFF * np.abs(young)).any():
            raise SceneError(
                f"{where}: its new youngModulus makes tetrahedra of one stiffness differ; give tetrahedra that "
                "will change another youngModulus from the start"
            )
        before = self._young[self._first]
        self._fields, self._young = fields, young
        after = young[self._first]
        return {self._names[number]: float(after[number]) for number in np.flatnonzero(after != before)}


def _present(field: DraftMaterial) -> DraftMaterial:
    """A force field with its present moduli; the same object if unchanged."""
    component = field.component
    if not component.reinit_requested and not flag(component, "updateStiffness", False):
        return field
    component.reinit_requested = False
    young = young_modulus(component, len(field.tetrahedra))
    return field if np.array_equal(young, field.young_modulus) else replace(field, young_modulus=young)
