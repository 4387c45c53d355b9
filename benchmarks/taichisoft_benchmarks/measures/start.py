"""From the start of Python to the first step, with and without kernels compiled before."""

import time

from taichisoft_benchmarks.descriptors import StartCase
from taichisoft_benchmarks.measures.measured import Measured, peak_memory
from taichisoft_benchmarks.scenes import Meshes, scene_of


def measure_start(case: StartCase, meshes: Meshes) -> Measured:
    """Import, model and first step; the runner gives a cold case an empty folder for compiled kernels."""
    started = time.perf_counter()
    import taichisoft.building.simulation

    imported = time.perf_counter()
    model = taichisoft.building.simulation.make_model(scene_of(case, meshes))
    made = time.perf_counter()
    taichisoft.building.simulation.Simulation(model).step()
    stepped = time.perf_counter()
    return Measured(
        {
            "import_s": imported - started,
            "model_s": made - imported,
            "first_step_s": stepped - made,
            "total_s": stepped - started,
            "peak_mb": peak_memory(),
        },
        {"nodes": model.node_count},
    )
