"""Where the scenes, meshes and scripts that come with taichisoft lie, in a checkout and in a wheel."""

import difflib
from pathlib import Path

from taichisoft.errors import TaichisoftError
from taichisoft.input_file import from_home, is_file, is_folder

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
) -> Path:
    """Find a file by path or by shipped name.

    `name` is taken as a path (relative to `beside`, then to the current folder); failing that, as
    the name of a file in the shipped folder `kind` ("scenes", "meshes", "fingers", "scripts"), with or
    without one of `suffixes`.

    Raises:
        error: nothing is there; the message lists the names that ship.
    """
    path = from_home(name)
    shipped = data_folder() / kind
    own = [folder for folder in (beside, Path()) if folder is not None]
    for folder in (*own, data_folder(), shipped):
        for suffix in ("", *suffixes):
            candidate = folder / f"{path}{suffix}"
            if is_file(candidate):
                return candidate.resolve()
    names = sorted(p.stem for p in shipped.glob("*") if p.suffix in suffixes) if shipped.is_dir() else []
    if str(name) and any(is_folder(folder / path) for folder in own):
        raise error(f"{name}: is a folder; a file ({', '.join(suffixes)}) is needed")
    near = difflib.get_close_matches(path.stem, names, n=1)
    hint = f"; did you mean '{near[0]}'?" if near else ""
    raise error(f"{name}: no such file, and none of the shipped {kind}: {', '.join(names) or 'none'}{hint}")
