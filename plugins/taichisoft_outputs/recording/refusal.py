"""What is said of a file that cannot be read as a recording: of another layout, damaged, or something else."""

from pathlib import Path
from typing import Any

from taichisoft_outputs.recording.layout import LAYOUT

WHAT_DAMAGE_RAISES = (OSError, RuntimeError, ValueError, KeyError, TypeError, AttributeError, OverflowError)
"""By h5py, and where its answers are used."""


def why_refused(path: Path, advice: str) -> str:
    """What is wrong with a file that begins like no recording of this layout."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            layout = file.attrs.get("layout", "none")
            version = file.attrs["taichisoft_version"]
            version = version if isinstance(version, str) else bytes(version).decode(errors="replace")
    except KeyError as error:
        return f"not a recording of taichisoft: {one_line(error)}"
    except WHAT_DAMAGE_RAISES as error:
        return f"not readable as HDF5: {one_line(error)}; {advice}"
    if layout == LAYOUT:
        return f"damaged: its beginning is not what was written; {advice}"
    return other_layout(version, layout)


def other_layout(version: str, layout: Any) -> str:
    """That another version wrote a file, and what to do."""
    return f"taichisoft {version} wrote it in layout {layout}, this version reads layout {LAYOUT}; run the scene again"


def one_line(error: BaseException) -> str:
    """What an error says, or its kind where it says nothing."""
    return " ".join(str(error).split()).strip("'\"") or type(error).__name__
