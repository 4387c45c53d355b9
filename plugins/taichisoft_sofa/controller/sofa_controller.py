"""The controller "sofa", which runs the controllers of a SOFA scene."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taichisoft.base import warn_caller
from taichisoft.control import Control, Controller, KeyEvent, Observation
from taichisoft.errors import ControllerFailed, SceneError
from taichisoft_sofa.components.reading import STATE
from taichisoft_sofa.components.states import keep_start_position
from taichisoft_sofa.controller.reads import RunValues
from taichisoft_sofa.controller.writes import DrivenFrames, SceneWrites
from taichisoft_sofa.loading import SceneTree, load_tree
from taichisoft_sofa.translation.translate import translate
from taichisoft_sofa.tree.value_kinds import canonical

if TYPE_CHECKING:
    from taichisoft.contact import Model

KEY_EVENTS = ("KeypressedEvent", "KeyreleasedEvent")


class SofaController(Controller):
    """Runs the controllers of a SOFA scene on its native translation.

    They receive events in the order of SOFA: end of a step, keys pressed since, beginning of the next step. Terminals
    do not report released keys, so a key is released after one step. Without controllers, pressures and cables keep
    their values in the scene.
    """

    def __init__(self, scene: str, python_path: Sequence[str] = (), exact: bool = False, data_path: Sequence[str] = ()):
        """Execute the scene.

        Args:
            scene: path of the SOFA scene.
            python_path: folders of libraries that the scene imports.
            exact: whether the translation follows SOFA exactly where the default departs from it.
            data_path: folders of meshes that the scene names.

        Raises:
            SceneError: the scene cannot be read.
        """
        self._scene, self._exact = Path(scene), exact
        self._folders, self._data_path = list(map(Path, python_path)), list(map(Path, data_path))
        self._fresh: SceneTree | None = self._load()
        handles_keys = any(
            controller.handles_event(event) for controller in self._fresh.controllers for event in KEY_EVENTS
        )
        self.bindings = {"any": "what the scene does with it"} if handles_keys else {}
        # Without a terminal there are no keys, and a run that waits for keys would never end.
        self.interactive = handles_keys and sys.stdin is not None and sys.stdin.isatty()

    def _load(self) -> SceneTree:
        return load_tree(self._scene, self._folders, self._data_path)

    def reset(self, model: "Model") -> None:
        """Execute the scene again, and connect it to a run of `model`.

        Raises:
            ControllerFailed: a controller of the scene failed, or the model belongs to another scene.
        """
        self._tree, self._fresh = self._fresh or self._load(), None
        translation = translate(self._tree, self._exact)
        try:
            driven = DrivenFrames(self._tree, translation)
            self._values = RunValues(self._tree, translation, model, driven)
            self._writes = SceneWrites(self._tree, translation, model, driven)
        except SceneError as error:
            raise ControllerFailed(f"{self._scene}: {error}") from error
        for component in self._tree.components():
            if canonical(component.type_name) == STATE:
                keep_start_position(component)
        self._tree.initialise()
        self._writes.begin()
        self._pressed: list[KeyEvent] = []
        self._held: list[KeyEvent] = []
        self._stepped = False

    def key(self, event: KeyEvent) -> None:
        """Queue a key, which the scene receives between two steps."""
        if event.value is None:
            self._pressed.append(event)

    def control(self, observation: Observation) -> Control:
        """Send the events to the scene, and return the request by its writes."""
        self._values.observe(observation)
        step = self._writes.time_step
        if self._stepped:
            self._tree.animate_end(step)
        for event in self._held:
            self._tree.key_released(event.key, event.ctrl)
        for event in self._pressed:
            self._tree.key_pressed(event.key, event.ctrl)
        self._held, self._pressed = self._pressed, []
        self._tree.animate_begin(step)
        self._stepped = True
        for line in self._writes.without_effect():
            warn_caller(line)
        return self._writes.control()

    def summary(self) -> dict[str, Any]:
        """Names of the scene's controllers, for the closing table of a run."""
        names = sorted({controller.type_name for controller in self._tree.controllers}) if self._has_run else []
        return {"controllers of the scene": ", ".join(names)} if names else {}

    @property
    def _has_run(self) -> bool:
        return hasattr(self, "_tree")
