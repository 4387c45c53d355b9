"""Damaged files of meshes, surfaces and STEP bodies, which are examined, meshed, or simulated."""

import random
import shutil
from pathlib import Path

from taichisoft_benchmarks.faults.damage import damaged_text
from taichisoft_benchmarks.faults.mistaken_scenes import base_scene

VOLUMES = ("whole.msh", "whole.vtk", "whole.vtu")
SURFACES = ("whole.stl", "whole.obj", "whole.ply")


def write_files() -> None:
    """A mesh and a surface in every format, and a scene that has one of each."""
    import tomli_w
    import trimesh

    from taichisoft.mesh import read_volume_mesh, write_volume_mesh

    document = base_scene()
    shutil.copy(document["soft_bodies"]["left"]["mesh"], "whole.msh")
    for name in VOLUMES[1:]:
        write_volume_mesh(read_volume_mesh("whole.msh"), name)
    for name in SURFACES:
        trimesh.creation.icosphere(1, 5.0).export(name)
    document["rigid_bodies"]["ball"] = {"surface": "whole.stl", "mass": 0.001, "position": [0.0, 0.0, 40.0]}
    Path("scene.toml").write_text(tomli_w.dumps(document))


def attempt(number: int) -> list[str]:
    """Do something with a damaged file."""
    dice = random.Random(f"mesh file {number}")
    whole = dice.choice(VOLUMES + SURFACES)
    tried = Path("tried").with_suffix(Path(whole).suffix)
    tried.write_bytes(damaged_text(Path(whole).read_bytes(), dice))
    if dice.random() < 0.3:
        return ["mesh", "info", str(tried)]
    if whole in VOLUMES:
        return _run(f"soft_bodies.left.mesh='{tried}'")
    if dice.random() < 0.2:
        return ["mesh", "--surfaces", str(tried), "--size", "4", "--output", "meshed.msh"]
    return _run(f"rigid_bodies.ball.surface='{tried}'")


def _run(change: str) -> list[str]:
    return ["run", "scene.toml", "--set", change, "--duration", "0.02", "--output", "out"]


def write_step_file() -> None:
    """A block with a round void."""
    from taichisoft_meshing.gmsh_session import gmsh_session

    with gmsh_session("whole.step") as gmsh:
        occ = gmsh.model.occ
        occ.cut([(3, occ.addBox(0.0, 0.0, 0.0, 20.0, 10.0, 10.0))], [(3, occ.addSphere(10.0, 5.0, 5.0, 3.0))])
        occ.synchronize()
        gmsh.write("whole.step")


def attempt_step_file(number: int) -> list[str]:
    """Mesh a damaged body; OpenCASCADE, which reads it, may crash."""
    dice = random.Random(f"STEP file {number}")
    Path("tried.step").write_bytes(damaged_text(Path("whole.step").read_bytes(), dice))
    return ["mesh", "tried.step", "--size", "5", "--force", "--output", "meshed.msh"]
