"""Environment of a running scene: modules in place of SOFA's, removed afterwards."""

import functools
import importlib
import importlib.util
import logging
import sys
from collections.abc import Callable, Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any

from taichisoft.errors import SceneError, nearest
from taichisoft_sofa.tree.component import Component, TreeObject
from taichisoft_sofa.tree.data import Data, LinkPath
from taichisoft_sofa.tree.node import MAKERS, Node
from taichisoft_sofa.tree.place import PACKAGE, here
from taichisoft_sofa.tree.scene_controller import KEYS, DataEngine, ForceField, PythonScriptController, SceneController
from taichisoft_sofa.tree.scene_modules import RUNNING, OurLoader, SceneFinder, SceneLoader, is_ours, running

# A stand-in for pyserial, for scenes that talk to a robot: no port is there, and nothing is sent or read.

LOG = logging.getLogger("taichisoft_sofa.scene")
IS_INSTALLED = importlib.util.find_spec("serial") is not None  # looked up once, since a search leaves traces in `sys`


class Serial:
    """A port to which nothing is connected."""

    def __init__(self, port: str | None = None, *_arguments: Any, **_named: Any) -> None:
        self.port, self.is_open, self.in_waiting = port, True, 0
        LOG.warning("serial.Serial(%r): pyserial is not installed; nothing is sent or read", port)

    def write(self, content: bytes) -> int:
        """Discard the content; returns its length."""
        return len(content)

    def readline(self, *_size: int) -> bytes:
        """Nothing."""
        return b""

    read = readline

    def close(self) -> None:
        """Close the port."""
        self.is_open = False

    flush = reset_input_buffer = reset_output_buffer = flushInput = flushOutput = open = lambda self: None


def serial_modules() -> dict[str, ModuleType]:
    """Modules in place of pyserial's, by name; none if it is installed."""
    if IS_INSTALLED:
        return {}
    names = ("serial", "serial.tools", "serial.tools.list_ports")
    serial, tools, ports = modules = [
        ModuleType(name, "In place of pyserial, which is not installed.") for name in names
    ]
    vars(serial).update(tools=tools, Serial=Serial, SerialException=OSError, __path__=[])
    vars(tools).update(list_ports=ports, __path__=[])
    vars(ports).update(comports=list)
    return dict(zip(names, modules, strict=True))


# Prefabs: nodes built from parameters, defined by scenes and SOFA's libraries.


class RawPrefab(Node):
    """A node of a class defined by a scene."""

    def __init__(self, *_arguments: Any, **named: Any) -> None:
        self.type_name = "Node"
        known = {name: value for name, value in named.items() if self.declared_data(name) is not None}
        self.set_all({"name": "unnamed", **known})

    def addPrefabParameter(
        self,
        name: str,
        help: str = "",
        type: str = "",
        default: Any = None,
    ) -> None:
        """Add a parameter of the prefab as a data."""
        self.addData(name, default, type=type)


class Prefab(RawPrefab):
    """A node whose content is made by its method `init`, from the parameters listed in its class."""

    prefabParameters: list[dict[str, Any]] = []  # noqa: RUF012
    prefabData: list[dict[str, Any]] = []  # noqa: RUF012
    properties: list[dict[str, Any]] = []  # noqa: RUF012

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **{"name": type(self).__name__, **named})
        self.addData("prefabname", type(self).__name__, type="string")
        for parent in named.get("parents", [named["parent"]] if "parent" in named else []):
            parent.addChild(self)
        for listed in (*self.prefabParameters, *self.prefabData, *self.properties):
            name = listed["name"]
            self.addData(name, named.get(name, listed.get("default")), type=listed.get("type", ""))
        self.init()


# Older names of scene libraries, if only their present generation is available.
#
# `stlib` and `splib` provide the functions of `stlib3` and `splib3` for scenes of the older generation: prefabs are
# attached to a node, the first argument or `attachedTo`, and rigid bodies have their older components.

PRESENT = {"stlib": "stlib3", "splib": "splib3"}
# Order of the arguments of prefabs in the older generation.
ARGUMENTS = {
    "ElasticMaterialObject": (
        "attachedTo",
        "volumeMeshFileName",
        "name",
        "rotation",
        "translation",
        "scale",
        "surfaceMeshFileName",
        "collisionMesh",
        "withConstrain",
        "surfaceColor",
        "poissonRatio",
        "youngModulus",
        "totalMass",
    ),
    "VisualModel": ("parent", "surfaceMeshFileName", "name", "color", "rotation", "translation", "scale"),
}
RIGID_BODIES = ("RigidObject", "Cube", "Floor", "Sphere")


class OlderLibraries(MetaPathFinder, OurLoader):
    """Finds stlib and splib as the last finder."""

    def find_spec(self, name: str, _path: Sequence[str] | None, _target: Any = None) -> ModuleSpec | None:
        """Specification of such a module; None if the present generation has no counterpart."""
        present = present_name(name)
        if present is None or not _exists(present):
            return None
        return ModuleSpec(name, self, is_package=True)

    def exec_module(self, module: ModuleType) -> None:
        """Copy the contents of the module of the present generation."""
        present = importlib.import_module(str(present_name(module.__name__)))
        for name, item in vars(present).items():
            if not name.startswith("__") and not isinstance(item, ModuleType):
                setattr(module, name, _as_before(name, item))


def present_name(name: str) -> str | None:
    """Present name of a module of an older library, or None."""
    library, _, rest = name.partition(".")
    present = PRESENT.get(library)
    return present and (f"{present}.{rest}" if rest else present)


def _exists(name: str) -> bool:
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:
        return False


def _as_before(name: str, item: Any) -> Any:
    if isinstance(item, type) and issubclass(item, Prefab) and name in ARGUMENTS:
        return _attached(item, ARGUMENTS[name])
    return _rigid_body(item) if name in RIGID_BODIES else item


def _attached(prefab: type[Prefab], arguments: Sequence[str]) -> Callable[..., Prefab]:
    """Convert a prefab to a function that attaches it to a node."""

    @functools.wraps(prefab, updated=())
    def made(*given: Any, **named: Any) -> Prefab:
        named |= dict(zip(arguments, given, strict=False))
        named["visualMeshPath"] = named.pop("surfaceMeshFileName", "") if "parent" in arguments else ""
        parent = named.pop(arguments[0], None)
        return prefab(**named, **({"parent": parent} if parent is not None else {}))

    return made


def _rigid_body(make: Callable[..., Node]) -> Callable[..., Node]:
    """Make a rigid body with the older names of its solvers, and with a constraint correction for contacts."""

    @functools.wraps(make)
    def made(*given: Any, **named: Any) -> Node:
        body = make(*given, **named)
        for component, former in (("EulerImplicitSolver", "odesolver"), ("CGLinearSolver", "Solver")):
            solver = body.getObject(component, warning=False)
            if solver is not None:
                solver.setName(former)
        if body.hasObject("Solver") and not body.hasObject("UncoupledConstraintCorrection"):
            body.addObject("UncoupledConstraintCorrection")
        return body

    return made


# Stand-ins for SOFA's modules, with an error of one line for missing names.


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
    types = StandIn("Sofa.Types", RGBAColor=_colour)
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
    # Scenes import a module of bindings so that its components have Python methods; data alone are needed here.
    bindings = (StandIn(name) for name in ("SofaTypes", "Sofa.SofaLinearSystem", "Sofa.SofaDeformable", "SofaExporter"))
    every = (sofa, core, gui, helper, simulation, types, constants, key, runtime, *bindings)
    return {module.__name__: module for module in every}


def _colour(*parts: Any) -> list[float]:
    """Sofa.Types.RGBAColor: red, green, blue and opacity, of numbers or a list of them."""
    given = [float(part) for part in (parts[0] if len(parts) == 1 else parts)]
    return [*given, 1.0] if len(given) == 3 else given


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
        RUNNING.append(self)
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
        RUNNING.remove(self)
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
