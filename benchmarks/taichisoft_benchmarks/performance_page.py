"""Fills the tables of docs/notes/performance.md from results, and draws the plots beside the page.

    python -m taichisoft_benchmarks.performance_page RESULTS.json --output docs/notes/performance.md

replaces what stands between `<!-- bench:SECTION -->` and `<!-- end -->`; the text around it is written by hand.
"""

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from taichisoft.errors import nearest
from taichisoft_benchmarks.case_results import CaseResult, Results, read_results
from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.figure_targets import NOTHING, PEERS, figure_text, targets_of
from taichisoft_benchmarks.growth_plots import draw_plots
from taichisoft_benchmarks.marked_page import heading, row
from taichisoft_benchmarks.program import run_program

MARKED = re.compile(r"<!-- bench:(\w+) -->\n(.*?)<!-- end -->", re.DOTALL)


def fill_page(page: str, results: Results) -> str:
    """The page with every marked section filled.

    Raises:
        BenchmarkError: a marker names no section.
    """

    def section(match: re.Match[str]) -> str:
        name = match[1]
        if name not in SECTIONS:
            raise BenchmarkError(f"bench:{name}: unknown section; {nearest(name, list(SECTIONS), 'there are')}")
        return f"<!-- bench:{name} -->\n{SECTIONS[name](results)}\n<!-- end -->"

    return MARKED.sub(section, page)


def machine_lines(results: Results) -> str:
    """The machine, its load, the versions."""
    machine, load = results.machine, results.load
    versions = ", ".join(f"{package} {version}" for package, version in results.versions.items())
    calibration = [value for case in results.cases.values() for value in case.calibration_ms]
    kernel = f"{min(calibration):.2f} to {max(calibration):.2f} ms" if calibration else "not measured"
    brief = "A quick look, one run of few steps: not to be quoted. " if results.quick else ""
    return (
        f"{brief}{results.started[:10]}, {machine['processor']}, {machine['cores']} cores, {machine['memory_gb']} GB, "
        f"{machine['system']}, Python {machine['python']}; load {load['start']:.2f} at the start, {load['end']:.2f} at "
        f"the end; meshes: {results.meshes}.\n{versions}.\nCalibration kernel: {kernel}."
    )


def targets_table(results: Results) -> str:
    """Every figure that has a target or a peer."""
    rows = [[label, f"`{name}`", *columns.values()] for label, name, columns in targets_of(results)]
    _, _, columns = next(targets_of(results))
    return _table(["case", "figure", *columns], rows)


def factorisation_table(results: Results) -> str:
    """Our factorisation beside CHOLMOD and SuperLU, and its speed beside that of a dense product."""
    header = ["case", "threads", "nodes", "MFLOP", "taichisoft, ms", "CHOLMOD, ms", "SuperLU, ms"]
    header += ["over CHOLMOD", "GFLOP/s", "of a dense product"]
    rows = []
    for name, case in _measured(results, kind="factorisation"):
        facts = case.facts
        times = [figure_text(case.figures.get(f"{who}_ms")) for who in ("factorise", "cholmod", "superlu")]
        speeds = [f"{facts['mflop'] / case.figures['factorise_ms'].median:.1f}", f"{facts['dense_gflops']:.1f}"]
        ratio = figure_text(case.figures.get("ratio_to_cholmod"))
        rows.append(
            [f"`{name}`", case.threads or "all", facts["nodes"], f"{facts['mflop']:.3g}", *times, ratio, *speeds]
        )
    return _table(header, rows)


def threads_table(results: Results) -> str:
    """Times on one thread and on two."""
    rows: list[list[Any]] = [
        [f"`{name}`", case.threads, metric, figure_text(figure)]
        for name, case in _measured(results)
        if "threads" in case.parameter
        for metric, figure in case.figures.items()
        if metric in ("factorise_ms", "hold_ms", "step_ms")
    ]
    gains = [[f"`{name}`", "", "gain", f"{value:.3g}"] for name, value in results.derived.items() if "_gain" in name]
    return _table(["case", "threads", "figure", "value"], [*rows, *gains])


def growth_table(results: Results, group: str) -> str:
    """The cases of a swept group, with the memory of the whole process."""
    header = ["nodes", "contacts", "sweeps", "ms per step", "us per node", "displacement, mm", "memory, MB"]
    rows = []
    for _, case in _measured(results, group=group):
        step, memory = case.figures["step_ms"], case.figures.get("peak_mb")
        facts = [_fact(case, fact) for fact in ("nodes", "step_contacts", "step_sweeps")]
        per_node = f"{1e3 * step.median / case.facts['nodes']:.2f}"
        rows.append([*facts, figure_text(step), per_node, _fact(case, "displacement_mm"), figure_text(memory)])
    per_finger = results.derived.get(f"{group}.mb_per_finger")
    note = f"\n\nMemory of one more finger: {per_finger:.3g} MB." if per_finger is not None else ""
    return _table(header, rows) + note


def start_table(results: Results) -> str:
    """Time from the start of Python to the first step."""
    rows = [
        [case.title, *(figure_text(case.figures[f"{part}_s"]) for part in ("import", "model", "first_step", "total"))]
        for _, case in _measured(results, kind="start")
    ]
    return _table(["case", "import, s", "model, s", "first step, s", "total, s"], rows)


def throughput_table(results: Results) -> str:
    """Runs at once, a process on each core."""
    header = ["processes", "steps of a run", "taichisoft, steps/s", "runs/min", "MuJoCo, steps/s", "over MuJoCo's"]
    rows = []
    for _, case in _measured(results, kind="throughput"):
        figures, steps = case.figures, case.facts["steps"]
        per_minute = f"{60.0 * figures['ours_per_s'].median / steps:.3g}"
        theirs = [figure_text(figures.get(name)) for name in ("mujoco_per_s", "over_mujoco")]
        rows.append([case.facts["processes"], steps, figure_text(figures["ours_per_s"]), per_minute, *theirs])
    return _table(header, rows)


def other_table(results: Results) -> str:
    """Meshing, rendering, recording, the web page and plug-ins."""
    rows = []
    for kind in ("meshing", "rendering", "recording", "web", "plugins"):
        for name, case in _measured(results, kind=kind):
            for metric, figure in case.figures.items():
                if not metric.endswith("_mb"):
                    rows.append([case.title, case.facts["nodes"], f"`{name}.{metric}`", figure_text(figure)])
    return _table(["case", "nodes", "figure", "value"], rows)


def tolerance_table(results: Results) -> str:
    """Time and error by the tolerance of the contact solver; the last case is the tightest."""
    cases = _measured(results, group="tuning_tolerance")
    rows = []
    for name, case in cases:
        off = max(abs(a - b) for a, b in zip(case.facts["object_mm"], cases[-1][1].facts["object_mm"], strict=True))
        facts = [case.facts["grasp_sweeps"], figure_text(case.figures["grasp_ms"]), f"{off:.1e}"]
        rows.append([name.removeprefix("tuning_tolerance_"), *facts])
    return _table(["tolerance, mm/s", "sweeps per step", "ms per step", "cube's place off by, mm"], rows)


def time_step_table(results: Results) -> str:
    """Time and error by the time step; the last case has the shortest."""
    cases = _measured(results, group="tuning_time_step")
    rows = []
    for name, case in cases:
        step = case.figures["step_ms"]
        length = float(name.removeprefix("tuning_time_step_").removesuffix("ms"))
        bends, exact = case.facts["displacement_mm"], cases[-1][1].facts["displacement_mm"]
        rows.append(
            [f"{length:g}", figure_text(step), f"{step.median / length:.2g}", f"{bends:.2f}", f"{bends - exact:+.2f}"]
        )
    header = ["step, ms", "ms per step", "s per simulated second", "displacement at 0.4 s, mm", "off, mm"]
    return _table(header, rows)


def peers_table(results: Results) -> str:
    """Parts of the job that other programs leave out, each named once, and the bend of their fingers beside ours."""
    rows: list[list[Any]] = []
    first: dict[str, str] = {}
    for name, case in results.cases.items():
        peer = next((peer for peer in reversed(PEERS) if case.group.endswith(f"_{peer}")), None)
        if peer is None:
            continue
        ours = results.cases.get(name.removesuffix(f"_{peer}"))
        if case.skipped or case.problem:
            rows.append([f"`{name}`", NOTHING, NOTHING, NOTHING, case.skipped or case.problem])
            continue
        facts = [_fact(ours, "displacement_mm"), _fact(case, "displacement_mm"), _fact(case, "unsolved")]
        first.setdefault(case.does_not, name)
        repeated = first[case.does_not] != name
        rows.append([f"`{name}`", *facts, f"as `{first[case.does_not]}`" if repeated else case.does_not])
    header = ["case", "displacement, ours, mm", "theirs, mm", "solves that stopped early", "does not"]
    return _table(header, rows)


def phases_table(results: Results) -> str:
    """The time of each phase of a step and the part of it in Python [ms]: a column for each case without sweep."""
    columns = {
        name: {**case.phases, "of it in Python": case.figures["python_ms"].median}
        for name, case in _measured(results, kind="steps")
        if case.phases and not case.parameter
    }
    phases = list(dict.fromkeys(phase for column in columns.values() for phase in column))
    # A phase that the first case lacks would otherwise follow the sums.
    phases.sort(key=lambda phase: phase in ("rest", "step", "of it in Python"))
    rows = [
        [phase, *(f"{column[phase]:.3f}" if phase in column else "–" for column in columns.values())]
        for phase in phases
    ]
    return _table(["ms", *(f"`{name}`" for name in columns)], rows)


def _measured(results: Results, kind: str = "", group: str = "") -> list[tuple[str, CaseResult]]:
    """The measured cases of a kind or of a group, with their names."""
    return [
        (name, case)
        for name, case in results.cases.items()
        if case.figures and kind in ("", case.kind) and group in ("", case.group)
    ]


def _fact(case: CaseResult | None, name: str) -> Any:
    return case.facts.get(name, NOTHING) if case is not None else NOTHING


def _table(header: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    if not rows:
        return "Not measured in this run."
    return "\n".join([heading(header), *map(row, rows)])


SECTIONS: dict[str, Callable[[Results], str]] = {
    "machine": machine_lines,
    "targets": targets_table,
    "factorisation": factorisation_table,
    "threads": threads_table,
    "nodes": lambda results: growth_table(results, "growth_nodes"),
    "contacts": lambda results: growth_table(results, "growth_contacts"),
    "fingers": lambda results: growth_table(results, "growth_fingers"),
    "tolerance": tolerance_table,
    "time_step": time_step_table,
    "start": start_table,
    "throughput": throughput_table,
    "other": other_table,
    "peers": peers_table,
    "phases": phases_table,
}


def main(
    results: Annotated[Path, typer.Argument(metavar="RESULTS.json", help="Results of the benchmarks.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="PAGE.md", help="Page to fill.")],
) -> None:
    """Fill the tables of a page, and draw the plots beside it."""
    measured = read_results(results)
    output.write_text(fill_page(output.read_text(encoding="utf-8"), measured), encoding="utf-8")
    draw_plots(measured, output.parent)


if __name__ == "__main__":
    run_program(main, "taichisoft_benchmarks.performance_page")
