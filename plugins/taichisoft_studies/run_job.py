"""One run of a study as plain data that can be sent to another machine, and the hash that its folder is called by."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import taichisoft
from taichisoft import Scene
from taichisoft.scenes import Table, scene_to_toml
from taichisoft_studies.errors import StudyError

DIGITS = 16
"""Digits of the hash in a folder's name."""


@dataclass(frozen=True)
class RunJob:
    """A run to be made.

    Attributes:
        name: name of its folder: the hash of all that decides its results.
        folder: absolute path of the folder that holds the folders of all runs.
        scene: resolved scene as TOML.
        source: name of the scene, which begins errors.
        parameters: values by key that distinguish it from other runs of the study.
        duration: simulated time [s]; None for the scene's.
        outputs: names of the outputs that watch it.
        plugins: paths of the plug-ins that it needs.
        seed: seed of Python's and numpy's random numbers.
        time_limit: longest time that it may take [s].
        watch: quantities recorded at every step, text of an expression by name; or None.
        pruning: settings of pruning, see `pruning.py`; None: no pruning.
    """

    name: str
    folder: str
    scene: str
    source: str
    parameters: Mapping[str, Any]
    duration: float | None = None
    outputs: tuple[str, ...] = ("metrics",)
    plugins: tuple[str, ...] = ()
    seed: int = 1
    time_limit: float = 3600.0
    watch: Mapping[str, str] | None = None
    pruning: Mapping[str, Any] | None = None

    @property
    def place(self) -> Path:
        """Its folder."""
        return Path(self.folder) / self.name

    def to_json(self) -> str:
        """As text, in one line."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> "RunJob":
        """What `to_json` wrote."""
        values = json.loads(text)
        return cls(**{**values, "outputs": tuple(values["outputs"]), "plugins": tuple(values["plugins"])})


def make_job(scene: Scene, folder: Path, **others: Any) -> RunJob:
    """The job of a run of a scene; `others` are the attributes of `RunJob` that are not worked out here.

    Raises:
        StudyError: a file that the scene or the job names cannot be read.
    """
    name = run_hash(
        scene, others.get("duration"), others.get("seed", 1), others.get("plugins", ()), others.get("watch")
    )
    return RunJob(name=name, folder=str(folder.resolve()), scene=scene_to_toml(scene), **others)


def run_hash(
    scene: Table, duration: float | None, seed: int, plugins: tuple[str, ...], watch: Mapping[str, str] | None = None
) -> str:
    """The hash of all that decides what comes out of a run: the resolved scene, seed, version, contents of its files.

    Files count by what is in them, not by where they lie, so that a study can be moved or done on two machines.

    Raises:
        StudyError: a file cannot be read.
    """
    parts = {
        "scene": _by_contents(scene.model_dump(mode="json", exclude_none=True)),
        "duration": duration,
        "seed": seed,
        "version": taichisoft.__version__,
        "plugins": [_code_digest(Path(plugin)) for plugin in plugins],
        "watch": dict(watch) if watch is not None else None,
    }
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:DIGITS]


def _by_contents(value: Any) -> Any:
    """Tables in which the absolute path of every file is replaced by a digest of the file."""
    if isinstance(value, Mapping):
        return {key: _by_contents(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_by_contents(one) for one in value]
    if isinstance(value, str) and value.startswith("/") and Path(value).is_file():
        return _file_digest(Path(value))
    return value


def _file_digest(path: Path) -> str:
    """A digest of a file; for a geometry file, also of the files that it names."""
    try:
        whole = hashlib.sha256(path.read_bytes())
        if path.suffix.lower() == ".toml":
            from taichisoft_meshing.fingerprint import named_files
            from taichisoft_meshing.geometry_file import read_tables

            for named in named_files(read_tables(path)[1], path.parent):
                whole.update(named.read_bytes())
    except OSError as error:
        raise StudyError(f"{path}: cannot be read: {error.strerror or error}") from error
    return whole.hexdigest()


def _code_digest(plugin: Path) -> str:
    files = sorted(plugin.rglob("*.py")) if plugin.is_dir() else [plugin]
    try:
        return hashlib.sha256(b"".join(hashlib.sha256(file.read_bytes()).digest() for file in files)).hexdigest()
    except OSError as error:
        raise StudyError(f"--plugin {plugin}: cannot be read: {error.strerror or error}") from error
