"""Import of a scene's own modules and of SOFA's libraries, without lasting effects on this Python."""

import importlib.util
import sys
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any

from taichisoft_sofa.tree.place import ORIGIN, ModuleOrigin
from taichisoft_sofa.tree.python2 import compiled
from taichisoft_sofa.tree.python2_names import NAMES

# Libraries of scenes, always executed with our modules in place of SOFA's.
LIBRARIES = ("stlib3", "splib3", "softrobots", "stlib", "splib")


class OurLoader(Loader):
    """Base class of loaders, which marks modules loaded for a scene."""

    def create_module(self, _spec: ModuleSpec) -> ModuleType | None:
        """None: Python makes the module."""
        return None


class SceneLoader(OurLoader):
    """Executes a file, which may be in Python 2, and records the origin of the module.

    Args:
        file: the file.
        of_scene: whether the file is the scene's own, not a library's.
        converted: receives the file and the reason if the file is in Python 2.
        in_package: whether the file is a package or in one.
    """

    def __init__(self, file: Path, of_scene: bool, converted: dict[Path, str], in_package: bool = False) -> None:
        self.file = file
        self.of_scene = of_scene
        self._converted = converted
        self._in_package = in_package

    def exec_module(self, module: ModuleType) -> None:
        """Execute the file."""
        program = compiled(self.file, self._in_package)
        vars(module)[ORIGIN] = ModuleOrigin(self.of_scene, program.older)
        if program.python2:
            self._converted[self.file] = program.python2
            vars(module).update(NAMES)
        exec(program.code, vars(module))

    def get_source(self, _name: str) -> str:
        """Text of the file, for tracebacks."""
        return self.file.read_text(encoding="utf-8", errors="replace")


class SceneFinder(MetaPathFinder):
    """Finds the modules in the scene's folder and in its libraries.

    Attributes:
        folders: folders to search, besides sys.path for libraries.
        converted: files in Python 2, with the reason.
    """

    def __init__(self, folder: Path, python_path: Sequence[Path]) -> None:
        self.folder = folder
        self.folders = [folder, *python_path]
        self.converted: dict[Path, str] = {}
        self._python_path = python_path

    def find_spec(self, name: str, path: Sequence[str] | None, _target: Any = None) -> ModuleSpec | None:
        """Specification of a module; None for other modules."""
        above, _, last = name.rpartition(".")
        if above:
            # Check the top package: the direct parent may be a folder without an __init__.py.
            if not is_ours(sys.modules.get(name.partition(".")[0])):
                return None
            folders = [Path(entry) for entry in path or ()]
        else:
            folders = self.folders + ([Path(entry) for entry in sys.path] if name in LIBRARIES else [])
        for folder in folders:
            for file, inside in ((folder / last / "__init__.py", [str(folder / last)]), (folder / f"{last}.py", None)):
                if file.is_file():
                    in_package = bool(above or inside)
                    loader = SceneLoader(file, self._is_of_scene(name, file), self.converted, in_package)
                    return importlib.util.spec_from_file_location(
                        name, file, loader=loader, submodule_search_locations=inside
                    )
        return None

    def _is_of_scene(self, name: str, file: Path) -> bool:
        """Whether a module is the scene's own and not part of a library, even of one in the scene's folder."""
        of_library = name.partition(".")[0] in LIBRARIES or any(
            file.is_relative_to(folder) and folder.is_relative_to(self.folder) for folder in self._python_path
        )
        return file.is_relative_to(self.folder) and not of_library


def is_ours(module: ModuleType | None) -> bool:
    """Whether a module was loaded for a scene."""
    return isinstance(getattr(getattr(module, "__spec__", None), "loader", None), OurLoader)
