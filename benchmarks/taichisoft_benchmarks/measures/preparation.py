"""Time before the first step: meshing, import, model, kernels."""

import time

from taichisoft.scene import find_file
from taichisoft_benchmarks.case_scenes import FINGER, Meshes, scene_of
from taichisoft_benchmarks.cases import MeshingCase, StartCase
from taichisoft_benchmarks.measures.measured import Measured, peak_memory


def measure_start(case: StartCase, meshes: Meshes) -> Measured:
    """Import, model and first step; a cold case runs with an empty folder for compiled kernels."""
    started = time.perf_counter()
    from taichisoft.running import Simulation, make_model

    imported = time.perf_counter()
    model = make_model(scene_of(case, meshes))
    made = time.perf_counter()
    Simulation(model).step()
    stepped = time.perf_counter()
    figures = {
        "import_s": imported - started,
        "model_s": made - imported,
        "first_step_s": stepped - made,
        "total_s": stepped - started,
        "peak_mb": peak_memory(),
    }
    return Measured(figures, {"nodes": model.node_count})


def measure_meshing(case: MeshingCase) -> Measured:
    """One mesh of the tutorial's finger; loading gmsh is not counted."""
    import gmsh  # noqa: F401

    from taichisoft_meshing.geometry_file import read_geometry
    from taichisoft_meshing.mesh_job import mesh_as_asked
    from taichisoft_meshing.wall_quality import radius_ratios

    file = find_file(FINGER, "fingers", ())
    started = time.perf_counter()
    mesh = mesh_as_asked(read_geometry(file), file, preset=case.preset)
    seconds = time.perf_counter() - started
    worst = radius_ratios(mesh.nodes, mesh.elements).min()
    return Measured(
        {"mesh_s": seconds, "peak_mb": peak_memory()},
        {"nodes": len(mesh.nodes), "elements": len(mesh.elements), "worst_radius_ratio": round(float(worst), 3)},
    )
