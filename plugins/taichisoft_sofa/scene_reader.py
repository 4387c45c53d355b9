"""Reader of SOFA's scenes for `taichisoft run scene.py`, and their check without a run."""

import contextlib
import io
import logging
import os
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taichisoft.base import cache_folder, checksum_file, is_as_kept, keep_checksum, named_os_errors, warn_caller
from taichisoft.errors import SceneError, TaichisoftError
from taichisoft_sofa.loading import SceneTree, load_tree
from taichisoft_sofa.translation.parts import NOTHING, Translation
from taichisoft_sofa.translation.translate import translate

if TYPE_CHECKING:
    from taichisoft import Simulation
    from taichisoft_sofa.controller.sofa_controller import SofaController

LOGGER = logging.getLogger("taichisoft.sofa")
CONTROLLER = "sofa"
CACHE_VARIABLE = "TAICHISOFT_CACHE"
DIGITS = 16  # digits of the hash in the name of a folder of meshes
FILE_KEYS = ("mesh", "surface", "file")


def read_scene(path: Path, python_path: str = "", sofa_exact: bool = False, data_path: str = "") -> dict[str, Any]:
    """Translate a SOFA scene to the tables of a native scene, with meshes in the user's cache folder.

    Args:
        path: the scene, a program that runs with the rights of the user.
        python_path: folders of libraries that the scene imports, separated as in PYTHONPATH.
        sofa_exact: whether to follow SOFA exactly where the default departs from it.
        data_path: folders of meshes, such as SOFA's share folder, separated as in PYTHONPATH.

    Raises:
        SceneError: the scene cannot be read or translated.
        MeshError: the meshes cannot be written.
    """
    tree, translation = translated(path, python_path, sofa_exact, data_path)
    for line in tree.converted:
        LOGGER.info("%s", line)
    if translation.refused:
        more = len(translation.refused) - 1
        rest = f" (and {more} more: taichisoft sofa check {path})" if more else ""
        raise SceneError(f"{translation.refused[0]}{rest}")
    if translation.is_empty:
        raise SceneError(f"{path}: {NOTHING}")
    for line in translation.departures:
        LOGGER.info("otherwise than in SOFA: %s", line)
    if translation.ignored:
        LOGGER.info("without effect here: %s", ", ".join(sorted(translation.ignored)))
    if translation.not_read:
        LOGGER.info("not read here: %s", translation.data_not_read)
    settings: dict[str, Any] = {"scene": str(path.resolve())}
    for key, value in (("python_path", python_path), ("data_path", data_path)):
        if folders := [str(folder.resolve()) for folder in split_path(value)]:
            settings[key] = folders
    if sofa_exact:
        settings["exact"] = True
    tables = with_files_in(kept_files(translation, path.stem), translation.tables)
    return {**tables, "controller": {"name": CONTROLLER, "settings": settings}}


def translated(scene: Path, python_path: str, exact: bool, data_path: str) -> tuple[SceneTree, Translation]:
    """Load a scene, with its libraries and meshes in folders separated as in PYTHONPATH, and translate it."""
    tree = load_tree(scene, split_path(python_path), split_path(data_path, "--data-path"))
    return tree, translate(tree, exact)


def split_path(folders: str, option: str = "--python-path") -> list[Path]:
    """Split the value of an option, a text of folders in the format of PYTHONPATH."""
    found = [Path(folder).expanduser() for folder in folders.split(os.pathsep) if folder]
    for folder in found:
        if not folder.is_dir():
            raise SceneError(f"{option} {folder}: no such folder")
    return found


def kept_files(translation: Translation, name: str) -> Path:
    """Folder with the files of a translation, named by a hash of their content.

    Missing files are written; changed files are written again, with a warning.
    """
    own = os.environ.get(CACHE_VARIABLE)
    cache = (Path(own).expanduser() if own else cache_folder()) / "sofa"
    folder = cache / f"{name}-{translation.files.fingerprint()[:DIGITS]}"
    changed = [file for file in translation.files.names if not is_as_kept(folder / file)]
    if changed:
        # A file without a checksum is incomplete: another process writes it, or was stopped while writing.
        for file in (name for name in changed if checksum_file(folder / name).exists()):
            warn_caller(f"{folder / file}: does not match its checksum; it is written again")
        with named_os_errors(f"{cache} ({CACHE_VARIABLE} can name another folder)"):
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(dir=cache, prefix=".partial-") as partial:
                translation.files.write(Path(partial))
                for file in changed:  # one by one, since other processes may read or write the same files
                    (Path(partial) / file).replace(folder / file)
                    keep_checksum(folder / file)
    return folder


def with_files_in(folder: Path, tables: Mapping[str, Any]) -> dict[str, Any]:
    """Make the paths of files in the tables absolute."""

    def located(value: Any, key: str = "") -> Any:
        if isinstance(value, Mapping):
            return {name: located(item, name) for name, item in value.items()}
        if isinstance(value, Sequence) and not isinstance(value, str):
            return [located(item) for item in value]
        return str(folder / value) if key in FILE_KEYS and isinstance(value, str) else value

    return {name: located(value, name) for name, value in tables.items()}


# Check of a scene without a run: its components, and construction of the model.


@dataclass
class Checked:
    """Results of a check, as lines of text.

    Attributes:
        problems: reasons why the scene cannot be run; empty if it can.
        remarks: files in Python 2, departures from SOFA, warnings of the model.
        said: lines printed by the scene.
        counts: number of components of each type, by "understood" and "without effect".
        not_read: data that the scene writes and nothing reads.
    """

    problems: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    counts: dict[str, Mapping[str, int]] = field(default_factory=dict)
    not_read: str = ""


def checked(scene: Path, python_path: str, exact: bool, data_path: str = "", steps: int = 0) -> Checked:
    """Load and translate a scene, and build its model and controllers as a run does; make some steps of it."""
    found = Checked()
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always", UserWarning)
        try:
            with _kept(found.said):
                tree, translation = translated(scene, python_path, exact, data_path)
            found.remarks += tree.converted
            found.counts = {"understood": translation.understood, "without effect": translation.ignored}
            found.not_read = translation.data_not_read
            found.remarks += [f"otherwise than in SOFA: {line}" for line in translation.departures]
            found.problems += translation.refused
            if translation.is_empty and not translation.refused:
                found.problems.append(f"{scene}: {NOTHING}")
            elif not translation.refused:
                _build(scene, translation, python_path, data_path, exact, steps, found)
        except TaichisoftError as error:
            found.problems.append(str(error))
        except Exception as error:  # the other scenes are checked all the same
            found.problems.append(f"{scene}: taichisoft fails on it: {type(error).__name__}: {error}")
    found.remarks += dict.fromkeys(f"warning: {one.message}" for one in warned if issubclass(one.category, UserWarning))
    return found


def _build(
    scene: Path,
    translation: Translation,
    python_path: str,
    data_path: str,
    exact: bool,
    steps: int,
    found: Checked,
) -> None:
    from taichisoft import Simulation, make_model, scene_from_dict
    from taichisoft_sofa.controller.sofa_controller import SofaController

    tables = with_files_in(kept_files(translation, scene.stem), translation.tables)
    model = make_model(scene_from_dict(tables, str(scene)))
    folders, data_folders = ([str(folder) for folder in split_path(path)] for path in (python_path, data_path))
    with _kept(found.said):
        controller = SofaController(str(scene), folders, exact, data_folders)
        controller.reset(model)
        if steps:
            _run(Simulation(model), controller, steps)


def _run(simulation: "Simulation", controller: "SofaController", steps: int) -> None:
    """Make steps, those before an error of which the error names."""
    for made in range(steps):
        try:
            simulation.step(controller.control(simulation.observe()))
        except TaichisoftError as error:
            raise TaichisoftError(f"after {made} of {steps} steps: {error}") from error


@contextlib.contextmanager
def _kept(said: list[str]) -> Iterator[None]:
    """Collect the distinct lines that a scene prints, since they may be unsafe for a terminal."""
    printed = io.StringIO()
    try:
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
            yield
    finally:
        said += [line for line in dict.fromkeys(printed.getvalue().splitlines()) if line not in said]
