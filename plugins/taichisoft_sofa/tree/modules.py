"""Environment of a running scene: modules in place of SOFA's, removed afterwards."""

import importlib.util
import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from taichisoft.errors import SceneError, nearest
from taichisoft_sofa.tree.node import MAKERS, Node
from taichisoft_sofa.tree.older_libraries import OlderLibraries
from taichisoft_sofa.tree.place import PACKAGE, here
from taichisoft_sofa.tree.scene_controller import PythonScriptController
from taichisoft_sofa.tree.scene_modules import SceneFinder, SceneLoader, is_ours
from taichisoft_sofa.tree.serial_stand_in import serial_modules
from taichisoft_sofa.tree.stand_ins import stand_ins

# Running scenes, innermost last, since a scene may load another.
_running: list["SceneModules"] = []


class SceneModules:
    """A reusable context for a scene's code: `with modules: ...`.

    Inside, `import Sofa` and similar imports return our modules, and the scene's folder and `python_path` are searched
    first. On exit, `sys.modules`, `sys.path` and `sys.meta_path` are restored; the scene's modules are kept for the
    next entry.

    Args:
        folder: the folder of the scene.
        python_path: folders of libraries that the scene imports.
        data_path: folders of meshes, such as SOFA's share folder, searched last.
    """

    def __init__(self, folder: Path, python_path: Sequence[Path] = (), data_path: Sequence[Path] = ()) -> None:
        self.folder = folder
        self._data_path = list(data_path)
        self._repositories: list[Path] = []
        self._modules = stand_ins(self._repositories) | serial_modules()
        self._names = _names_of_modules(folder)
        self._finder = SceneFinder(folder, python_path)
        self._added_path = [str(folder), *map(str, python_path)]
        self._depth = 0
        importlib.invalidate_caches()

    def __enter__(self) -> "SceneModules":
        self._depth += 1
        if self._depth > 1:
            return self
        _running.append(self)
        self._known = dict(sys.modules)
        self._path, self._hooks = list(sys.path), list(sys.meta_path)
        self._path_cache = set(sys.path_importer_cache)
        self._no_bytecode = sys.dont_write_bytecode
        for name in self._hidden():
            del sys.modules[name]
        sys.modules.update(self._modules)
        sys.path[:0] = self._added_path
        sys.meta_path[:0] = [self._finder, OlderLibraries()]
        sys.dont_write_bytecode = True  # nothing is written beside a scene
        return self

    def __exit__(self, *_raised: object) -> None:
        self._depth -= 1
        if self._depth:
            return
        _running.remove(self)
        imported = [name for name, module in sys.modules.items() if self._known.get(name) is not module]
        belonging = {name for name in imported if self._is_of_scene(sys.modules[name])}
        self._modules |= {name: sys.modules[name] for name in belonging}
        for name in belonging | self._modules.keys():
            sys.modules.pop(name, None)
        sys.modules.update({name: module for name, module in self._known.items() if name not in sys.modules})
        self._added_path = [entry for entry in sys.path if entry not in self._path]
        sys.path[:], sys.meta_path[:] = self._path, self._hooks
        sys.dont_write_bytecode = self._no_bytecode
        for entry in set(sys.path_importer_cache) - self._path_cache:
            del sys.path_importer_cache[entry]

    @property
    def converted(self) -> dict[Path, str]:
        """Files in Python 2, with the reason."""
        return self._finder.converted

    def add_folder(self, folder: Path) -> None:
        """Add a folder to search for modules."""
        if folder not in self._finder.folders:
            self._finder.folders.append(folder)

    def run_file(self, file: Path, name: str) -> ModuleType:
        """Execute a file of the scene as a module, once."""
        if name not in self._modules:
            loader = SceneLoader(file, True, self._finder.converted)
            spec = importlib.util.spec_from_file_location(name, file, loader=loader)
            assert spec is not None
            module = sys.modules[name] = importlib.util.module_from_spec(spec)
            try:
                loader.exec_module(module)
            except BaseException:
                del sys.modules[name]
                raise
            self._modules[name] = module
        return self._modules[name]

    def find_file(self, name: str) -> Path | None:
        """A file of the scene: beside it, in a folder that it registers, or in the data path; None if missing."""
        found = (folder / name for folder in (self.folder, *self._repositories, *self._data_path))
        return next((file for file in found if file.is_file()), None)

    def _hidden(self) -> list[str]:
        """Other modules with the names of modules of the scene, and their submodules."""
        ours = self._names | {name.partition(".")[0] for name in self._modules}
        taken = {name for name in ours if name in sys.modules}
        return [name for name in sys.modules if name.partition(".")[0] in taken] if taken else []

    def _is_of_scene(self, module: Any) -> bool:
        """Whether a module imported by the scene belongs to it, or refers to our modules in place of SOFA's."""
        if str(getattr(module, "__name__", "")).startswith("taichisoft"):
            return False
        if is_ours(module) or any(_lies_in(module, Path(entry)) for entry in self._added_path):
            return True
        return any(
            (isinstance(value, ModuleType) and self._modules.get(value.__name__) is value)
            or (isinstance(value, type) and value.__module__.partition(".")[0] == PACKAGE)
            for value in list(getattr(module, "__dict__", {}).values())
        )


def running() -> SceneModules:
    """Modules of the running scene."""
    if not _running:
        raise RuntimeError("no scene is running")
    return _running[-1]


def _names_of_modules(folder: Path) -> set[str]:
    """Names of the modules and packages in a folder, except Python's own and ours, which take precedence."""
    files = {file.stem for file in folder.glob("*.py")} | {file.parent.name for file in folder.glob("*/__init__.py")}
    return {name for name in files - sys.stdlib_module_names if not name.startswith("taichisoft")}


def _lies_in(module: Any, folder: Path) -> bool:
    """Whether a module is in a folder, outside Python environments in it."""
    places = [getattr(module, "__file__", None), *list(getattr(module, "__path__", None) or ())]
    paths = [Path(place) for place in places if isinstance(place, str)]
    return any(path.is_relative_to(folder) and "site-packages" not in path.parts for path in paths)


def _python_script(node: Node, data: dict[str, Any]) -> PythonScriptController:
    """The controller of a scene of the older generation, by its file and class."""
    scene = running()
    name, class_name = str(data.get("filename", "")), str(data.get("classname", ""))
    file = scene.find_file(name)
    if file is None:
        raise SceneError(f"{here()}: PythonScriptController: filename = '{name}': no such file in {scene.folder}")
    scene.add_folder(file.parent)
    module = scene.run_file(file, f"__sofa_script__{file}")
    made = getattr(module, class_name, None)
    if not isinstance(made, type) or not issubclass(made, PythonScriptController):
        known = [key for key, item in vars(module).items() if isinstance(item, type)]
        hint = nearest(class_name, known, "its classes are")
        raise SceneError(f"{here()}: {name} has no PythonScriptController '{class_name}'; {hint}")
    controller = made(node)
    controller.set_all(data)
    if hasattr(made, "onLoaded"):
        controller.onLoaded(node)
    return controller


MAKERS["PythonScriptController"] = _python_script
