"""`taichisoft characterise`: how far a finger bends, and how hard it presses."""

from pathlib import Path
from typing import Annotated

import typer

from taichisoft.terminal_text import say


def characterise(
    scene: Annotated[str, typer.Argument(help="Scene file, or the name of a shipped one, with a finger.")],
    pressure: Annotated[float, typer.Option(help="Last pressure \\[kPa]; below 0 it is suction.")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder of the results  \\[default: out/SCENE-characteristics]"),
    ] = None,
    body: Annotated[str | None, typer.Option(help="The finger  \\[default: the first soft body]")] = None,
    steps: Annotated[int, typer.Option(min=2, max=200, help="Steps of pressure.")] = 8,
    bends: Annotated[
        int, typer.Option(min=1, max=50, help="Bends at which a block holds the tip, at most one for each step.")
    ] = 3,
    set: Annotated[list[str] | None, typer.Option(metavar="KEY=VALUE", help="Override a value (repeatable).")] = None,
    second: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE",
            help="What differs on a second mesh, for the error (repeatable)  \\[default: a finer one, if known]",
        ),
    ] = None,
) -> None:
    """Find a finger's free bending, blocked force and stiffness over its pressure: table, plot and datasheet."""
    import math  # --help need not wait for any of these

    import numpy as np
    from rich.console import Console

    from taichisoft import load_scene
    from taichisoft.running import warnings_printed_to
    from taichisoft_studies.characteristics import characterise as find_characteristics
    from taichisoft_studies.characteristics import equilibrium_count
    from taichisoft_studies.commands.study_options import progress_bar
    from taichisoft_studies.datasheet import trust_line, write_datasheet
    from taichisoft_studies.errors import StudyError
    from taichisoft_studies.refinement import finer_meshes

    if not (math.isfinite(pressure) and pressure != 0.0):
        raise StudyError(f"--pressure {pressure:g}: must be a number of kPa other than 0")
    pressures = np.linspace(0.0, pressure, steps + 1).tolist()
    loaded = load_scene(scene, set or ())
    if pressure < -loaded.atmosphere:
        raise StudyError(f"--pressure {pressure:g}: must be at least the vacuum's {-loaded.atmosphere:g} kPa")
    console, found = Console(), []
    with warnings_printed_to(console):
        changes = second or finer_meshes(loaded, body or next(iter(loaded.soft_bodies), None))[0]
        for what, overrides in (("equilibria", ()), *((("on the second mesh", changes),) if changes else ())):
            of_mesh = load_scene(scene, (*(set or ()), *overrides))
            with progress_bar(console, what, equilibrium_count(len(pressures), bends)) as advance:
                found.append(find_characteristics(of_mesh, body, pressures, bends, advance))
    other, change = (found[1], ", ".join(changes)) if changes else (None, "")
    folder = output or Path("out") / f"{Path(scene).stem}-characteristics"
    say(trust_line(found[0], other, change))
    for path in write_datasheet(folder, loaded, found[0], other, change):
        say(path)
