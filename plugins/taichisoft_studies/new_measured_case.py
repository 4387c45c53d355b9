"""`taichisoft new measured-case`: a folder to fill with what was measured of a finger."""

import shutil
from pathlib import Path
from typing import Annotated

import typer

from taichisoft.base import say

FOLDER = "measured-case"


def measured_case(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder to write.")] = Path(FOLDER),
) -> None:
    """Write a folder for a measured finger: geometry, silicone, pressures, positions and their errors."""
    from taichisoft.base import named_os_errors
    from taichisoft.scene import data_folder
    from taichisoft_studies.errors import StudyError

    if output.exists():
        raise StudyError(f"--output {output}: exists already; choose another name")
    with named_os_errors(output, StudyError):
        shutil.copytree(data_folder() / FOLDER, output)
    say(f"{output}: begin with {output / 'README.md'}")
