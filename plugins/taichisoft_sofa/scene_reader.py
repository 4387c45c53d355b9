"""Reader of SOFA's Python scenes for `taichisoft run scene.py`."""

import logging
import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from taichisoft.base import cache_folder, checksum_file, is_as_kept, keep_checksum, named_os_errors, warn_caller
from taichisoft.errors import SceneError
from taichisoft_sofa.translation.parts import NOTHING, Translation
from taichisoft_sofa.translation.translate import translate
from taichisoft_sofa.tree.loading import load_tree

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
    folders, data_folders = split_path(python_path), split_path(data_path, "--data-path")
    tree = load_tree(path, folders, data_folders)
    for line in tree.converted:
        LOGGER.info("%s", line)
    translation = translate(tree, sofa_exact)
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
    settings: dict[str, Any] = {"scene": str(path.resolve())}
    if folders:
        settings["python_path"] = [str(folder.resolve()) for folder in folders]
    if data_folders:
        settings["data_path"] = [str(folder.resolve()) for folder in data_folders]
    if sofa_exact:
        settings["exact"] = True
    tables = with_files_in(kept_files(translation, path.stem), translation.tables)
    return {**tables, "controller": {"name": CONTROLLER, "settings": settings}}


def split_path(folders: str, option: str = "--python-path") -> list[Path]:
    """Split the value of an option, a text of folders in the format of PYTHONPATH.

    Raises:
        SceneError: a folder does not exist.
    """
    found = [Path(folder).expanduser() for folder in folders.split(os.pathsep) if folder]
    for folder in found:
        if not folder.is_dir():
            raise SceneError(f"{option} {folder}: no such folder")
    return found


def kept_files(translation: Translation, name: str) -> Path:
    """Folder with the files of a translation, named by a hash of their content.

    Missing files are written; changed files are written again, with a warning.

    Raises:
        TaichisoftError: the files cannot be written.
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
