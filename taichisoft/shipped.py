"""Where the scenes, meshes and scripts that come with taichisoft lie, in a checkout and in a wheel."""

from pathlib import Path

from taichisoft.errors import TaichisoftError

PACKAGE = Path(__file__).resolve().parent


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
    path = Path(name).expanduser()
    shipped = data_folder() / kind
    folders = [folder for folder in (beside, Path(), data_folder(), shipped) if folder is not None]
    for folder in folders:
        for suffix in ("", *suffixes):
            candidate = folder / f"{path}{suffix}"
            if candidate.is_file():
                return candidate.resolve()
    names = sorted(p.stem for p in shipped.glob("*") if p.suffix in suffixes) if shipped.is_dir() else []
    raise error(f"{name}: no such file, and none of the shipped {kind}: {', '.join(names) or 'none'}")
