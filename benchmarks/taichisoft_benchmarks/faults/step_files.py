"""Damaged STEP files, which are meshed; OpenCASCADE, which reads them, may crash on some."""

import random
from pathlib import Path

from taichisoft_benchmarks.faults.damage import damaged_text


def write_files() -> None:
    """A block with a round void in it."""
    from taichisoft_meshing.gmsh_session import gmsh_session

    with gmsh_session("whole.step") as gmsh:
        occ = gmsh.model.occ
        occ.cut([(3, occ.addBox(0.0, 0.0, 0.0, 20.0, 10.0, 10.0))], [(3, occ.addSphere(10.0, 5.0, 5.0, 3.0))])
        occ.synchronize()
        gmsh.write("whole.step")


def attempt(number: int) -> list[str]:
    """Mesh a damaged body."""
    dice = random.Random(f"STEP file {number}")
    Path("tried.step").write_bytes(damaged_text(Path("whole.step").read_bytes(), dice))
    return ["mesh", "--step", "tried.step", "--size", "5", "--force", "--output", "meshed.msh"]
