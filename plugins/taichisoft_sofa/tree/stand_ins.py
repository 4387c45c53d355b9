"""Stand-ins for SOFA's modules, with an error of one line for missing names."""

import logging
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

from taichisoft.errors import SceneError
from taichisoft_sofa.tree.base import TreeObject
from taichisoft_sofa.tree.component import Component
from taichisoft_sofa.tree.data import Data, LinkPath
from taichisoft_sofa.tree.key_characters import KEYS
from taichisoft_sofa.tree.node import Node
from taichisoft_sofa.tree.own_components import DataEngine, ForceField
from taichisoft_sofa.tree.place import here
from taichisoft_sofa.tree.prefab import Prefab, RawPrefab
from taichisoft_sofa.tree.scene_controller import PythonScriptController, SceneController

LOG = logging.getLogger("taichisoft_sofa.scene")


class StandIn(ModuleType):
    """A module in place of a module of SOFA."""

    def __init__(self, name: str, **contents: Any) -> None:
        super().__init__(name, "In place of SOFA's module, while a scene is read by taichisoft.")
        self.__path__: list[str] = []
        vars(self).update(contents)
        # For `from Sofa.constants import *`.
        self.__all__ = [key for key in contents if not key.startswith("_")]

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        known = ", ".join(sorted(self.__all__)) or "nothing"
        raise AttributeError(f"taichisoft's {self.__name__} has no '{name}'; it has {known}")


class Repository:
    """Folders in which a scene's files are searched."""

    def __init__(self, folders: list[Path]) -> None:
        self._folders = folders

    def addFirstPath(self, folder: str) -> None:
        """Add a folder to search before all others."""
        self._folders.insert(0, Path(folder).absolute())

    def addLastPath(self, folder: str) -> None:
        """Add a folder to search after all others."""
        self._folders.append(Path(folder).absolute())

    def getFile(self, name: str) -> str:
        """Path of a file; its name if not found."""
        return next((str(folder / name) for folder in self._folders if (folder / name).is_file()), name)

    findFile = getFile


def stand_ins(repositories: list[Path]) -> dict[str, ModuleType]:
    """Our modules in place of SOFA's, by name; folders of files that the scene adds go to `repositories`."""
    messages = {f"msg_{level}": _message(number) for level, number in LEVELS.items()}
    core = StandIn(
        "Sofa.Core",
        Base=TreeObject,
        BaseData=Data,
        BaseObject=Component,
        Controller=SceneController,
        Data=Data,
        DataContainer=Data,
        DataEngine=DataEngine,
        DataString=Data,
        **{f"ForceField{template}": ForceField for template in ("", "Vec1d", "Vec2d", "Vec3d", "Vec6d", "Rigid3d")},
        LinkPath=LinkPath,
        Node=Node,
        Object=Component,
        Prefab=Prefab,
        RawPrefab=RawPrefab,
    )
    key = StandIn("Sofa.constants.Key", **KEYS)
    constants = StandIn("Sofa.constants", Key=key)
    helper = StandIn("Sofa.Helper", **messages)
    simulation = StandIn(
        "Sofa.Simulation", init=lambda node: node.init(), **{name: _own_loop(name) for name in OWN_LOOPS}
    )
    types = StandIn("Sofa.Types")
    gui = StandIn("Sofa.Gui")
    sofa = StandIn(
        "Sofa",
        Core=core,
        Gui=gui,
        Helper=helper,
        Node=Node,
        Prefab=Prefab,
        PythonScriptController=PythonScriptController,
        Simulation=simulation,
        Types=types,
        constants=constants,
        getAvailableComponents=list,
        **messages,
    )
    repository = Repository(repositories)
    runtime = StandIn(
        "SofaRuntime", DataRepository=repository, PluginRepository=Repository([]), importPlugin=lambda name: True
    )
    every = (sofa, core, gui, helper, simulation, types, constants, key, runtime, StandIn("SofaTypes"))
    return {module.__name__: module for module in every}


OWN_LOOPS = ("animate", "animateNSteps", "load", "reset", "unload", "updateVisual", "initVisual")
"""Functions of Sofa.Simulation by which a program steps a scene itself."""


def _own_loop(name: str) -> Callable[..., None]:
    """Make a function that refuses a loop of the scene's own."""

    def refused(*_arguments: Any, **_named: Any) -> None:
        raise SceneError(
            f"{here()}: Sofa.Simulation.{name}() is a loop of the scene's own; the steps are made by `taichisoft run` "
            "(--steps N), or in Python by taichisoft.run(taichisoft.load_scene(FILE)): leave it out, and let a "
            "Sofa.Core.Controller do what happens in every step"
        )

    return refused


LEVELS = {
    "deprecated": logging.INFO,
    "error": logging.ERROR,
    "fatal": logging.CRITICAL,
    "info": logging.INFO,
    "warning": logging.WARNING,
}


def _message(level: int) -> Callable[..., None]:
    """Make a function that logs a scene's messages, optionally preceded by their subject."""

    def message(*said: Any) -> None:
        about = [item.getPathName() if isinstance(item, TreeObject) else str(item) for item in said]
        LOG.log(level, ": ".join(about))

    return message
