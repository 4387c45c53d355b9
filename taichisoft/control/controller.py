"""What drives a run: the interface of a controller."""

from typing import TYPE_CHECKING, Protocol

from taichisoft.control.control import Control
from taichisoft.control.observation import Observation

if TYPE_CHECKING:
    from taichisoft.model import Model


class Controller(Protocol):
    """Anything with these two methods drives a run.

    It may also have:

    - `key(event: KeyEvent) -> None`: called for every key that the run does not use itself, before `control`;
    - `bindings: dict[str, str]`: what its keys do, for the help that `?` shows;
    - `sliders: dict[str, Slider]`: numbers that its user may set, by name, for displays that can show them (see
      `taichisoft.control.slider.Slider`); one that was moved comes as a `KeyEvent` with that name and its `value`;
    - `interactive = True`: a run goes at the speed of real time and until somebody ends it, unless the user says
      otherwise;
    - `status: str`: what the live status of such a run shows of it, such as which finger is selected;
    - `summary() -> dict[str, str]`: rows for the table that closes a run.

    A controller that cannot do its job raises `taichisoft.errors.ControllerFailed`: the run ends with its outputs
    complete.
    """

    def reset(self, model: "Model") -> None:
        """Called before the first step, and again when a user starts the run anew."""

    def control(self, observation: Observation) -> Control:
        """Called before every step, or every `controller.period` of the scene."""
        ...
