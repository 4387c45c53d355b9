"""The controller "sofa": a run is steered by the controllers that its SOFA scene defines."""

import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taichisoft.control.control import Control
from taichisoft.control.controller import Controller
from taichisoft.control.keys import KeyEvent
from taichisoft.control.observation import Observation
from taichisoft.errors import ControllerFailed, SceneError
from taichisoft_sofa.controller.reads import RunValues
from taichisoft_sofa.controller.writes import SceneWrites
from taichisoft_sofa.translation.translate import translate
from taichisoft_sofa.tree.loading import SceneTree, load_tree

if TYPE_CHECKING:
    from taichisoft.model import Model

KEY_EVENTS = ("KeypressedEvent", "KeyreleasedEvent")


class SofaController(Controller):
    """Lets the controllers of a SOFA scene drive its native translation.

    They are told of keys and steps as in SOFA: of the end of a step, of the keys pressed since, of the beginning of the
    next step. Terminals do not say when a key is let go: it is after one step. Where the scene has no controllers, its
    pressures and cables keep the values that it gives them.
    """

    def __init__(self, scene: str, python_path: Sequence[str] = (), exact: bool = False):
        """Execute the scene.

        Args:
            scene: path of the SOFA scene.
            python_path: folders of libraries that it imports.
            exact: whether the translation keeps SOFA's reading where the usual one departs from it.

        Raises:
            SceneError: the scene cannot be read.
        """
        self._scene, self._exact = Path(scene), exact
        self._folders = [Path(folder) for folder in python_path]
        self._fresh: SceneTree | None = self._load()
        heeds_keys = any(
            controller.handles_event(event) for controller in self._fresh.controllers for event in KEY_EVENTS
        )
        self.bindings = {"any": "what the scene does with it"} if heeds_keys else {}
        # Without a terminal nobody steers, and a run that waits for keys would never end.
        self.interactive = heeds_keys and sys.stdin is not None and sys.stdin.isatty()

    def _load(self) -> SceneTree:
        return load_tree(self._scene, self._folders)

    def reset(self, model: "Model") -> None:
        """Execute the scene anew, and let it see and steer a run of `model`.

        Raises:
            ControllerFailed: one of its controllers failed, or the model is not that of the scene.
        """
        self._tree, self._fresh = self._fresh or self._load(), None
        translation = translate(self._tree, self._exact)
        try:
            self._values = RunValues(self._tree, translation, model)
            self._writes = SceneWrites(self._tree, translation, model)
        except SceneError as error:
            raise ControllerFailed(f"{self._scene}: {error}") from error
        self._tree.initialise()
        self._writes.begin()
        self._pressed: list[KeyEvent] = []
        self._held: list[KeyEvent] = []
        self._stepped = False

    def key(self, event: KeyEvent) -> None:
        """Keep a key for the scene, which is told of it between two steps."""
        if event.value is None:
            self._pressed.append(event)

    def control(self, observation: Observation) -> Control:
        """Tell the scene what happens, and ask for what it wrote."""
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
            warnings.warn(line, stacklevel=2)
        return self._writes.control()

    def summary(self) -> dict[str, Any]:
        """The scene's controllers, for the table that closes a run."""
        names = sorted({controller.type_name for controller in self._tree.controllers}) if self._has_run else []
        return {"controllers of the scene": ", ".join(names)} if names else {}

    @property
    def _has_run(self) -> bool:
        return hasattr(self, "_tree")
