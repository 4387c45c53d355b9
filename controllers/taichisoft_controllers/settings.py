"""The base class of the controllers' settings."""

from typing import Any, Self

from pydantic import ValidationError

from taichisoft.errors import SceneError
from taichisoft.scenes import Table, first_problem


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
