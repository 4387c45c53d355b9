"""Loading of a SOFA scene: its file is executed, and builds a tree."""

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from taichisoft.errors import ControllerFailed, SceneError, TaichisoftError
from taichisoft_sofa.components.known_components import known_types
from taichisoft_sofa.tree.component import Component
from taichisoft_sofa.tree.modules import SceneModules
from taichisoft_sofa.tree.node import Node
from taichisoft_sofa.tree.place import ORIGIN, ModuleOrigin, Place, frozen_time
from taichisoft_sofa.tree.scene_controller import PythonComponent, character
from taichisoft_sofa.tree.scene_modules import LIBRARIES, is_xml

# Sources of libraries that scenes import.
SOURCES = {
    **dict.fromkeys(("stlib3", "splib3", "stlib", "splib"), "github.com/SofaDefrost/STLIB, its folder python3/src"),
    "softrobots": "github.com/SofaDefrost/SoftRobots, its folder python3",
}


DEEPEST = 200
"""Largest depth of nodes: more are an error of the scene, and would cause a RecursionError."""


class SceneTree:
    """The tree built by a scene.

    Attributes:
        path: file of the scene.
        root: root node.
    """

    def __init__(self, path: Path, python_path: Sequence[Path], data_path: Sequence[Path] = ()) -> None:
        known_types()
        self.path = path
        self.root = Node("root")
        self._modules = SceneModules(path.parent, python_path, data_path)

    def nodes(self) -> Iterator[Node]:
        """All nodes, each once, from the root down."""
        return self.root.walk()

    def components(self) -> Iterator[Component]:
        """All components, node by node, in the order of their addition."""
        return self.root.walk_components()

    @property
    def controllers(self) -> list[PythonComponent]:
        """Controllers defined by the scene, in the order of their construction."""
        found = (component for component in self.components() if isinstance(component, PythonComponent))
        return sorted(found, key=lambda controller: controller._order)

    @property
    def converted(self) -> list[str]:
        """One line for each file in Python 2 that was converted."""
        return [
            f"{file} is in Python 2 ({why}): it is converted, and the quotient of integers is an integer"
            for file, why in self._modules.converted.items()
        ]

    def find_file(self, name: str) -> Path | None:
        """A file of the scene: beside it, in a folder that it registers, or in the data path; None if missing."""
        return self._modules.find_file(name)

    def initialise(self) -> None:
        """Initialise the controllers of the complete scene, as SOFA does."""
        for item in (*self.nodes(), *self.components()):
            item.initialised = True
        with self._running(SceneError):
            for controller in self.controllers:
                controller.scene_is_complete()

    def key_pressed(self, key: str, ctrl: bool = False) -> None:
        """Send a pressed key to the controllers, see `keys.character`.

        Args:
            key: name of the key, or its character; a capital letter is typed with Shift.
            ctrl: whether Ctrl is pressed.
        """
        self._send_key("KeypressedEvent", key, ctrl)

    def key_released(self, key: str, ctrl: bool = False) -> None:
        """Send a released key to the controllers; arguments and errors as for `key_pressed`."""
        self._send_key("KeyreleasedEvent", key, ctrl)

    def _send_key(self, event: str, key: str, ctrl: bool) -> None:
        if (known := character(key)) is not None:
            shift = len(key) == 1 and key.isupper()
            self._send_event(event, {"key": known, "isShiftPressed": shift, "isCtrlPressed": ctrl})

    def animate_begin(self, dt: float) -> None:
        """Send the beginning of a step of length `dt` [s] to the controllers."""
        self._send_event("AnimateBeginEvent", {"dt": dt})

    def animate_end(self, dt: float) -> None:
        """Send the end of a step of length `dt` [s] to the controllers."""
        self._send_event("AnimateEndEvent", {"dt": dt})

    def _send_event(self, event: str, content: dict[str, Any]) -> None:
        receivers = [controller for controller in self.controllers if controller.handles_event(event)]
        if receivers:
            with self._running(ControllerFailed):
                for controller in receivers:
                    controller.handle_event(event, content)

    @contextlib.contextmanager
    def _running(self, failure: type[TaichisoftError]) -> Iterator[SceneModules]:
        """Context for the scene's code; its exceptions become errors of one line."""
        try:
            with self._modules, frozen_time():
                yield self._modules
        except TaichisoftError as error:
            raise failure(str(error)) from error
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # any exception of a scene's code ends only the scene
            raise failure(_line(error, self.path)) from error


def load_tree(
    path: Path | str, python_path: Sequence[Path | str] = (), data_path: Sequence[Path | str] = ()
) -> SceneTree:
    """Execute a scene's `createScene`.

    A scene is a program, which runs with the rights of the user.

    Args:
        path: file of the scene: .py, .pyscn or .scn.
        python_path: folders of libraries that the scene imports, such as STLIB's.
        data_path: folders of meshes, such as SOFA's share folder.
    """
    path = Path(path).absolute()
    if not path.is_file():
        raise SceneError(f"{path}: no such file")
    folders = [Path(folder).absolute() for folder in python_path]
    data_folders = [Path(folder).absolute() for folder in data_path]
    for folder in (*folders, *data_folders):
        if not folder.is_dir():
            raise SceneError(f"{folder}: no such folder to find a scene's libraries or meshes in")
    # A program without this function, named by mistake, is not executed.
    try:
        source = path.read_bytes()
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror or error}") from error
    if not is_xml(source) and b"createScene" not in source and b"import *" not in source:
        raise SceneError(f"{path}: has no function createScene(root)")
    tree = SceneTree(path, folders, data_folders)
    with tree._running(SceneError) as modules, contextlib.chdir(path.parent):
        create = getattr(modules.run_file(path, "__sofa_scene__"), "createScene", None)
        if not callable(create):
            raise SceneError(f"{path}: has no function createScene(root)")
        create(tree.root)
        if (deepest := _depth(tree.root)) > DEEPEST:
            raise SceneError(f"{path}: its nodes are nested {deepest} deep; at most {DEEPEST} are known here")
    return tree


def _depth(root: Node) -> int:
    """Number of levels of nodes."""
    level, depth = [root], 0
    while level:
        level, depth = list({id(child): child for node in level for child in node.children}.values()), depth + 1
    return depth


def _line(error: BaseException, path: Path) -> str:
    """Message about an exception of a scene's code, with the line of the scene."""
    if isinstance(error, ModuleNotFoundError) and error.name:
        library, _, inside = error.name.partition(".")
        if library in LIBRARIES and inside:
            found = f"the {library} that was found; another version has it"
            return f"{_place(error, path)}: there is no '{error.name}' in {found}"
        if library in LIBRARIES:
            return (
                f"{_place(error, path)}: there is no '{library}'; it comes from {SOURCES[library]}: "
                "give the folder that has it with --python-path DIR"
            )
    if isinstance(error, SyntaxError) and error.filename:
        return f"{error.filename}, line {error.lineno}: {error.msg}"
    try:
        said = " ".join(str(error).split())
    except Exception:  # an exception of the scene whose text fails
        said = ""
    return f"{_place(error, path)}: {type(error).__name__}{': ' if said else ''}{said}"


def _place(error: BaseException, path: Path) -> str:
    """Innermost line of the scene's files that led to an error, and the line of a called library."""
    of_scene: Place | Path = path
    of_library = None
    traceback: TracebackType | None = error.__traceback__
    while traceback is not None:
        frame = traceback.tb_frame
        origin = frame.f_globals.get(ORIGIN)
        if isinstance(origin, ModuleOrigin):
            place = Place(frame.f_code.co_filename, traceback.tb_lineno)
            of_scene, of_library = (place, None) if origin.of_scene else (of_scene, place)
        traceback = traceback.tb_next
    return f"{of_scene}" if of_library is None else f"{of_scene}, in {of_library}"
