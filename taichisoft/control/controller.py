"""What drives a run: the base class of every controller."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from taichisoft.control.control import Control
from taichisoft.control.keys import KeyEvent
from taichisoft.control.observation import Observation
from taichisoft.errors import PluginError

if TYPE_CHECKING:  # a model brings Taichi
    from taichisoft.model import Model


@dataclass(frozen=True)
class Slider:
    """A number that a controller lets its user set at once.

    Attributes:
        value: present value, also after keys that changed it.
        lowest: smallest value that can be set.
        highest: largest value that can be set.
        step: distance between two values that can be set.
        unit: unit of the other four, such as "kPa".
        group: title under which displays show it together with others; "" for the name of the controller.
    """

    value: float
    lowest: float
    highest: float
    step: float
    unit: str
    group: str = ""

    def __post_init__(self) -> None:
        """Check the range.

        Raises:
            PluginError: it ends before it begins, or it has no step.
        """
        if not (self.lowest <= self.highest and self.step > 0.0):
            raise PluginError(f"{self}: lowest must not be above highest, and step must be above 0")


class Controller(ABC):
    """Base class of everything that drives a run; only `control` must be written.

    A controller that cannot do its job raises `taichisoft.errors.ControllerFailed`: the run ends, and its outputs are
    complete.

    Attributes:
        interactive: whether a person steers: such a run keeps to real time and goes on until somebody ends it, unless
            the user says otherwise.
        bindings: effect of each key that the controller uses, by key, for the help that `?` shows.
        sliders: numbers that a person may set, by name, for displays that can show sliders; one that was moved comes
            to `key` as a `KeyEvent` with that name and its `value`.
        tunable: settings of the controller that a person may change while the run goes on, by name, for displays that
            can show sliders; the values are those that settings have by default. One that was moved makes the
            controller anew, with `save` and `restore`; a controller that does not save has none.
        status: text about the controller for displays, such as which finger is selected.
    """

    interactive: bool = False
    bindings: Mapping[str, str] = MappingProxyType({})
    sliders: Mapping[str, Slider] = MappingProxyType({})
    tunable: Mapping[str, Slider] = MappingProxyType({})
    status: str = ""

    def reset(self, model: "Model") -> None:
        """Prepare for a run: called before the first step, and again when a user starts the run again."""

    def key(self, event: KeyEvent) -> None:
        """Heed a key that the run does not use itself; called before `control`."""

    @abstractmethod
    def control(self, observation: Observation) -> Control:
        """Say what shall happen: called before every step, or every `controller.period` of the scene."""

    def save(self) -> dict[str, Any] | None:
        """Everything that the controller remembers from one `control` to the next, so that a run can go on from here.

        Called after `reset`, before the first step, and after every step that is recorded. The values are what JSON
        has: None, True and False, numbers, texts, lists, dictionaries with texts as keys (arrays by `tolist()`, a
        generator of random numbers by its `bit_generator.state`). A controller that depends on its observations alone
        gives {}.

        Returns:
            The values by name; None, as here, where the controller cannot say: a resumed run begins with `reset` then.
        """
        return None

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on from what `save` gave; called after `reset`.

        What it then asks for must be what it would have asked for, had the run not been interrupted.

        Raises:
            PluginError: the class has no `restore` of its own.
        """
        if saved:
            raise PluginError(f"{type(self).__qualname__} has save() without restore(); write both, or neither")

    def base_stops_at(self, observation: Observation) -> float | None:
        """The earliest time from which the base stays where it is in a run that begins with an observation [s].

        None where only the run itself shows it. A run whose goal is to be judged before is warned of.
        """
        return None

    def summary(self) -> dict[str, str]:
        """Rows for the table that closes a run, value by name."""
        return {}
