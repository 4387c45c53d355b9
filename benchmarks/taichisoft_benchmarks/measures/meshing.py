"""gmsh on the tutorial's finger."""

import time

from taichisoft.scenes.shipped import find_file
from taichisoft_benchmarks.descriptors import MeshingCase
from taichisoft_benchmarks.measures.measured import Measured, peak_memory


def measure_meshing(case: MeshingCase) -> Measured:
    """One mesh; loading gmsh is not counted."""
    import gmsh  # noqa: F401

    from taichisoft_meshing.geometry_file import read_geometry
    from taichisoft_meshing.mesh_job import mesh_as_asked
    from taichisoft_meshing.quality.tetrahedra import radius_ratios

    file = find_file("tutorial", "fingers", (".toml",))
    started = time.perf_counter()
    mesh = mesh_as_asked(read_geometry(file), file, size=case.element_size, preset=case.preset)
    seconds = time.perf_counter() - started
    worst = radius_ratios(mesh.nodes, mesh.elements).min()
    return Measured(
        {"mesh_s": seconds, "peak_mb": peak_memory()},
        {"nodes": len(mesh.nodes), "elements": len(mesh.elements), "worst_radius_ratio": round(float(worst), 3)},
    )
