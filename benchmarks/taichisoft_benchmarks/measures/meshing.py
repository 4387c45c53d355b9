"""gmsh on the tutorial's finger."""

import time

from taichisoft_benchmarks.descriptors import MeshingCase
from taichisoft_benchmarks.measures.measured import Measured, peak_memory


def measure_meshing(case: MeshingCase) -> Measured:
    """One mesh; loading gmsh is not counted."""
    import gmsh  # noqa: F401

    from taichisoft_meshing.finger import ElementSizes, FingerParameters
    from taichisoft_meshing.gmsh_mesher import mesh_finger
    from taichisoft_meshing.quality import radius_ratios

    size = case.element_size
    started = time.perf_counter()
    mesh = mesh_finger(FingerParameters(mesh=ElementSizes(largest=size, smallest=size)))
    seconds = time.perf_counter() - started
    worst = radius_ratios(mesh.nodes, mesh.elements).min()
    return Measured(
        {"mesh_s": seconds, "peak_mb": peak_memory()},
        {"nodes": len(mesh.nodes), "elements": len(mesh.elements), "worst_radius_ratio": round(float(worst), 3)},
    )
