"""The base class of the controllers' settings."""

import re
from typing import Any, Self

from pydantic import ValidationError

from taichisoft.control import Slider
from taichisoft.errors import SceneError
from taichisoft.scenes import Table, first_problem, key_descriptions


class ControllerSettings(Table):
    """Settings of a controller, as `controller.settings` of a scene gives them."""

    @classmethod
    def checked(cls, **settings: Any) -> Self:
        """The settings as valid data.

        Raises:
            SceneError: a key is unknown or missing, or a value is not valid.
        """
        try:
            return cls.model_validate(settings)
        except ValidationError as error:
            raise SceneError(first_problem(error, cls, "controller.settings")) from error


def tunable_settings(settings: type[ControllerSettings]) -> dict[str, Slider]:
    """Sliders of all settings that are numbers with a fraction, up to three times what they usually are.

    The unit is what stands in brackets at the end of a setting's docstring.
    """
    found, meanings = {}, key_descriptions(settings)
    for name, field in settings.model_fields.items():
        if not isinstance(field.default, float):
            continue
        step = field.default / 100.0
        lowest = max(
            (one + step if key == "gt" else one)
            for bound in field.metadata
            for key in ("gt", "ge")
            if (one := getattr(bound, key, None)) is not None
        )
        unit = re.search(r"\[([^\]]*)\]\.?$", meanings[name])
        found[name] = Slider(field.default, lowest, 3.0 * field.default, step, unit[1] if unit else "1")
    return found
