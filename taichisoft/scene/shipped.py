"""Where the scenes, meshes and scripts that come with taichisoft lie, in a checkout and in a wheel."""

import difflib
from collections.abc import Sequence
from pathlib import Path

from taichisoft.base.files import from_home, is_file, is_folder
from taichisoft.errors import TaichisoftError

PACKAGE = Path(__file__).resolve().parents[1]


def data_folder() -> Path:
    """The folder `data`: inside the package when installed from a wheel, beside it in a checkout."""
    installed = PACKAGE / "data"
    return installed if installed.is_dir() else PACKAGE.parent / "data"


def find_file(
    name: str | Path,
    kind: str,
    suffixes: tuple[str, ...],
    beside: Path | None = None,
    error: type[TaichisoftError] = TaichisoftError,
    also: Sequence[tuple[str, tuple[str, ...]]] = (),
) -> Path:
    """Find a file by path or by shipped name.

    `name` is taken as a path (relative to `beside`, then to the current folder); failing that, as
    the name of a file in the shipped folder `kind` ("scenes", "meshes", "fingers", "scripts"), with or
    without one of `suffixes`; failing that, likewise with each folder and suffixes of `also`.

    Raises:
        error: nothing is there; the message lists the names that ship.
    """
    path = from_home(name)
    own = [folder for folder in (beside, Path()) if folder is not None]
    places = ((kind, suffixes), *also)
    for shipped, ends in places:
        for folder in (*own, data_folder(), data_folder() / shipped):
            for suffix in ("", *ends):
                candidate = folder / f"{path}{suffix}"
                if is_file(candidate):
                    return candidate.resolve()
    if str(name) and any(is_folder(folder / path) for folder in own):
        raise error(f"{name}: is a folder; a file ({', '.join(suffixes)}) is needed")
    names = {shipped: _shipped_names(shipped, ends) for shipped, ends in places}
    near = difflib.get_close_matches(path.stem, [stem for stems in names.values() for stem in stems], n=1)
    hint = f"; did you mean '{near[0]}'?" if near else ""
    listed = "; ".join(f"{shipped}: {', '.join(stems) or 'none'}" for shipped, stems in names.items())
    raise error(f"{name}: no such file, and none of the shipped {listed}{hint}")


def _shipped_names(kind: str, suffixes: tuple[str, ...]) -> list[str]:
    return sorted(path.stem for path in (data_folder() / kind).glob("*") if path.suffix in suffixes)
