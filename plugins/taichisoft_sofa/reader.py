"""Reading SOFA's Python scenes as native ones: the hook of `taichisoft run scene.py`."""

import logging
import os
import tempfile
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from taichisoft.atomic_file import named_os_errors
from taichisoft.cache_folder import cache_folder
from taichisoft.checksum import checksum_file, is_as_kept, keep_checksum
from taichisoft.errors import SceneError
from taichisoft_sofa.translation.parts import Translation
from taichisoft_sofa.translation.translate import translate
from taichisoft_sofa.tree.loading import load_tree

LOGGER = logging.getLogger("taichisoft.sofa")
CONTROLLER = "sofa"
CACHE_VARIABLE = "TAICHISOFT_CACHE"
DIGITS = 16  # of the hash, in the name of a folder of meshes
FILE_KEYS = ("mesh", "surface", "file")


def read_scene(path: Path, python_path: str = "", sofa_exact: bool = False) -> dict[str, Any]:
    """The tables of the native scene that a SOFA scene becomes; its meshes go to the user's cache folder.

    Args:
        path: the scene, a program that runs with the rights of who reads it.
        python_path: folders of libraries that it imports, separated as in PYTHONPATH.
        sofa_exact: whether to keep SOFA's reading where the usual one departs from it.

    Raises:
        SceneError: the scene cannot be read, or has something that cannot be translated.
        MeshError: the meshes cannot be written.
    """
    folders = split_path(python_path)
    tree = load_tree(path, folders)
    for line in tree.converted:
        LOGGER.info("%s", line)
    translation = translate(tree, sofa_exact)
    if translation.refused:
        more = len(translation.refused) - 1
        rest = f" (and {more} more: taichisoft sofa check {path})" if more else ""
        raise SceneError(f"{translation.refused[0]}{rest}")
    for line in translation.departures:
        LOGGER.info("otherwise than in SOFA: %s", line)
    if translation.ignored:
        LOGGER.info("without effect here: %s", ", ".join(sorted(translation.ignored)))
    settings: dict[str, Any] = {"scene": str(path.resolve())}
    if folders:
        settings["python_path"] = [str(folder.resolve()) for folder in folders]
    if sofa_exact:
        settings["exact"] = True
    tables = with_files_in(kept_files(translation, path.stem), translation.tables)
    return {**tables, "controller": {"name": CONTROLLER, "settings": settings}}


def split_path(folders: str) -> list[Path]:
    """The folders of a text as PYTHONPATH has them.

    Raises:
        SceneError: one does not exist.
    """
    found = [Path(folder).expanduser() for folder in folders.split(os.pathsep) if folder]
    for folder in found:
        if not folder.is_dir():
            raise SceneError(f"--python-path {folder}: no such folder")
    return found


def kept_files(translation: Translation, name: str) -> Path:
    """The folder with the files of a translation, whose name has a hash of them.

    They are written unless they are there, and anew, with a warning, where one is not as it was written.

    Raises:
        TaichisoftError: they cannot be written.
    """
    own = os.environ.get(CACHE_VARIABLE)
    cache = (Path(own).expanduser() if own else cache_folder()) / "sofa"
    folder = cache / f"{name}-{translation.files.fingerprint()[:DIGITS]}"
    changed = [file for file in translation.files.names if not is_as_kept(folder / file)]
    if changed:
        # A file without a checksum is being written by another process, or that was stopped at it.
        for file in (one for one in changed if checksum_file(folder / one).exists()):
            warnings.warn(f"{folder / file}: is not as it was written, by its checksum; it is made anew", stacklevel=2)
        with named_os_errors(f"{cache} ({CACHE_VARIABLE} can name another folder)"):
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(dir=cache, prefix=".partial-") as partial:
                translation.files.write(Path(partial))
                for file in changed:  # one by one: another process may read the others, or write the same
                    (Path(partial) / file).replace(folder / file)
                    keep_checksum(folder / file)
    return folder


def with_files_in(folder: Path, tables: Mapping[str, Any]) -> dict[str, Any]:
    """The tables with absolute paths of the files that they name."""

    def located(value: Any, key: str = "") -> Any:
        if isinstance(value, Mapping):
            return {name: located(item, name) for name, item in value.items()}
        if isinstance(value, Sequence) and not isinstance(value, str):
            return [located(item) for item in value]
        return str(folder / value) if key in FILE_KEYS and isinstance(value, str) else value

    return {name: located(value, name) for name, value in tables.items()}
