"""A controller's wishes, checked and taken over into the state."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from taichisoft.controller import Control
from taichisoft.errors import ControlError
from taichisoft.model import Model
from taichisoft.state import State


def apply_control(model: Model, state: State, control: Control) -> State:
    """The state with what `control` asks for; what it does not mention keeps its last value.

    Raises:
        ControlError: no `Control`, an unknown cavity, a cavity driven both ways, or a value that is no finite number.
    """
    if not isinstance(control, Control):
        raise ControlError(f"control = {control!r}: must be a taichisoft.Control")
    for key in ("pressure", "volume_growth"):
        if not isinstance(getattr(control, key), Mapping):
            raise ControlError(f"control.{key} = {getattr(control, key)!r}: must be a dictionary by name of cavity")
    both = sorted(control.pressure.keys() & control.volume_growth.keys())
    if both:
        raise ControlError(f"control: cavity '{both[0]}' is given a pressure and a volume growth; give one of them")
    imposed, target = state.cavity_volume_imposed.copy(), state.cavity_target.copy()
    for wishes, by_volume, what in (
        (control.pressure, False, "pressure"),
        (control.volume_growth, True, "volume_growth"),
    ):
        for name, value in wishes.items():
            if name not in model.cavities.names:
                known = ", ".join(model.cavities.names) or "none"
                raise ControlError(f"control.{what}: no cavity is called '{name}'; there are: {known}")
            index = model.cavities.names.index(name)
            imposed[index] = by_volume
            target[index] = _finite(value, f"control.{what}['{name}']", ())
    return replace(
        state,
        cavity_volume_imposed=imposed,
        cavity_target=target,
        base_translation=_vector(control.base_translation, state.base_translation, "control.base_translation"),
        base_rotation=_vector(control.base_rotation, state.base_rotation, "control.base_rotation"),
    )


def _vector(value: np.ndarray | None, last: np.ndarray, key: str) -> np.ndarray:
    return last if value is None else _finite(value, key, (3,))


def _finite(value: object, key: str, shape: tuple[int, ...]) -> np.ndarray:
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ControlError(f"{key} = {value!r}: must be a number or an array of numbers") from error
    if array.shape != shape or not np.isfinite(array).all():
        wanted = f"{shape[0]} finite numbers" if shape else "a finite number"
        raise ControlError(f"{key} = {value!r}: must be {wanted}")
    return array
