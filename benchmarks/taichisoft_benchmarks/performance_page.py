"""Fills the tables of docs/notes/performance.md from results, and draws the plots of growth beside the page.

    python -m taichisoft_benchmarks.performance_page RESULTS.json --output docs/notes/performance.md

replaces what stands between `<!-- bench:SECTION -->` and `<!-- end -->`; the text around it is written by hand.
"""

import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Annotated, Any

import typer

from taichisoft.errors import nearest
from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.pages import heading, row, run_program, svg_axes
from taichisoft_benchmarks.results import CaseResult, RepeatedMetric, Results, read_results

MARKED = re.compile(r"<!-- bench:(\w+) -->\n(.*?)<!-- end -->", re.DOTALL)
TARGETS = Path(__file__).with_name("figure_targets.toml")
OURS = "taichisoft"
PEERS = {"mujoco": "MuJoCo", "mujoco_1000": "MuJoCo, 1000 iterations", "drake": "Drake"}
"""Names of the other programs by the ends of their cases' names."""
SHARE = "of MuJoCo's time"
NOTHING = "-"

Column = Callable[[str, CaseResult], Any]
"""The cell of a case in a table, from its name and its result."""

GROWTHS = {
    "growth_nodes": ("nodes", "nodes of the finger"),
    "growth_contacts": ("step_contacts", "contacts"),
    "growth_fingers": ("nodes", "nodes of 1 to 12 fingers"),
}
"""The fact of the cases on the horizontal axis of a plot, and the name of the axis, by group of cases."""


def fill_page(page: str, results: Results) -> str:
    """The page with every marked section filled."""

    def section(match: re.Match[str]) -> str:
        name = match[1]
        if name not in SECTIONS:
            raise BenchmarkError(f"bench:{name}: unknown section; {nearest(name, list(SECTIONS), 'there are')}")
        return f"<!-- bench:{name} -->\n{SECTIONS[name](results)}\n<!-- end -->"

    return MARKED.sub(section, page)


def targets_of(results: Results) -> Iterator[tuple[str, str, dict[str, str]]]:
    """Every figure that has a target or a peer (figure_targets.toml), measured or not.

    Yields:
        The figure in words, its name "case.metric", and as text, "-" where there is none: ours, the target, what SOFA
        took once, what other programs took in the same run, our share of MuJoCo's time (the median over the rounds, in
        each of which the two ran one after the other) and the target of that share.
    """
    for case, metrics in tomllib.loads(TARGETS.read_text(encoding="utf-8")).items():
        for metric, about in metrics.items():
            peer_metric = about.get("peers", metric)
            given = {key: f"{about[key]:g}" if key in about else NOTHING for key in ("target", "sofa", "share")}
            columns = {
                OURS: _value(results, case, metric),
                "target": given["target"],
                "SOFA": given["sofa"],
                **{name: _value(results, f"{case}_{peer}", peer_metric) for peer, name in PEERS.items()},
                SHARE: _share(results, case, metric, peer_metric),
                f"{SHARE}, target": given["share"],
            }
            yield about["label"], f"{case}.{metric}", columns


def figure_text(figure: RepeatedMetric | None) -> str:
    """Median, with half the spread when it can be seen."""
    if figure is None:
        return NOTHING
    scatter = f" ± {figure.spread / 2:.2g}" if figure.spread > 0.005 * abs(figure.median) else ""
    return f"{figure.median:.3g}{scatter}" if abs(figure.median) < 1000 else f"{figure.median:.0f}{scatter}"


def _value(results: Results, case: str, metric: str) -> str:
    """A figure of a case, or of a whole group."""
    if case in results.cases:
        return figure_text(results.cases[case].figures.get(metric))
    value = results.derived.get(f"{case}.{metric}")
    return NOTHING if value is None else f"{value:.3g}"


def _share(results: Results, case: str, metric: str, peer_metric: str) -> str:
    ours, mujoco = results.cases.get(case), results.cases.get(f"{case}_mujoco")
    if ours is None or mujoco is None or metric not in ours.figures or peer_metric not in mujoco.figures:
        return NOTHING
    # A run that was stopped in between has one value more of ours.
    pairs = zip(ours.figures[metric].values, mujoco.figures[peer_metric].values, strict=False)
    return f"{median(mine / theirs for mine, theirs in pairs):.2f}"


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
    figures = list(targets_of(results))
    rows = [[label, f"`{name}`", *columns.values()] for label, name, columns in figures]
    return _table(["case", "figure", *figures[0][2]], rows)


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


def other_table(results: Results) -> str:
    """Meshing, rendering, recording, the web page and plug-ins."""
    rows = [
        [case.title, case.facts["nodes"], f"`{name}.{metric}`", figure_text(figure)]
        for kind in ("meshing", "rendering", "recording", "web", "plugins")
        for name, case in _measured(results, kind=kind)
        for metric, figure in case.figures.items()
        if not metric.endswith("_mb")
    ]
    return _table(["case", "nodes", "figure", "value"], rows)


def growth_table(results: Results, group: str) -> str:
    """The cases of a swept group, with the memory of the whole process."""
    per_finger = results.derived.get(f"{group}.mb_per_finger")
    note = f"\n\nMemory of one more finger: {per_finger:.3g} MB." if per_finger is not None else ""
    return _cases_table(results, GROWTH_COLUMNS, group=group) + note


def tolerance_table(results: Results) -> str:
    """Time and error by the tolerance of the contact solver; the last case is the tightest."""

    def off(_: str, case: CaseResult) -> str:
        exact = _measured(results, group="tuning_tolerance")[-1][1].facts["object_mm"]
        return f"{max(abs(a - b) for a, b in zip(case.facts['object_mm'], exact, strict=True)):.1e}"

    columns: dict[str, Column] = {
        "tolerance, mm/s": lambda name, _: name.removeprefix("tuning_tolerance_"),
        "sweeps per step": _fact("grasp_sweeps"),
        "ms per step": _figure("grasp_ms"),
        "cube's place off by, mm": off,
    }
    return _cases_table(results, columns, group="tuning_tolerance")


def time_step_table(results: Results) -> str:
    """Time and error by the time step; the last case has the shortest."""

    def length(name: str) -> float:
        return float(name.removeprefix("tuning_time_step_").removesuffix("ms"))

    def off(_: str, case: CaseResult) -> str:
        exact = _measured(results, group="tuning_time_step")[-1][1].facts["displacement_mm"]
        return f"{case.facts['displacement_mm'] - exact:+.2f}"

    columns: dict[str, Column] = {
        "step, ms": lambda name, _: f"{length(name):g}",
        "ms per step": _figure("step_ms"),
        "s per simulated second": lambda name, case: f"{case.figures['step_ms'].median / length(name):.2g}",
        "displacement at 0.4 s, mm": lambda _, case: f"{case.facts['displacement_mm']:.2f}",
        "off, mm": off,
    }
    return _cases_table(results, columns, group="tuning_time_step")


def peers_table(results: Results) -> str:
    """Parts of the job that other programs leave out, each named once, and the bend of their fingers beside ours."""
    rows: list[list[Any]] = []
    first: dict[str, str] = {}
    displacement = _fact("displacement_mm")
    for name, case in results.cases.items():
        peer = next((peer for peer in reversed(PEERS) if case.group.endswith(f"_{peer}")), None)
        if peer is None:
            continue
        if case.skipped or case.problem:
            rows.append([f"`{name}`", NOTHING, NOTHING, NOTHING, case.skipped or case.problem])
            continue
        ours = results.cases.get(name.removesuffix(f"_{peer}"))
        origin = first.setdefault(case.does_not, name)
        facts = [displacement(name, ours) if ours else NOTHING, displacement(name, case), _fact("unsolved")(name, case)]
        rows.append([f"`{name}`", *facts, case.does_not if origin == name else f"as `{origin}`"])
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


def draw_plots(results: Results, folder: Path) -> list[Path]:
    """Draw every growth of which two cases were measured into `folder/GROUP.svg`."""
    paths = []
    for group, (fact, axis) in GROWTHS.items():
        points = growth_points(results.cases, group, fact)
        if len(points) < 2:
            continue
        count, middle, least, largest = zip(*points, strict=True)
        with svg_axes(folder / f"{group}.svg", (4.6, 3.1)) as axes:
            axes.fill_between(count, least, largest, alpha=0.25, linewidth=0)
            axes.loglog(count, middle, marker="o", markersize=4, label="median of the runs")
            axes.loglog(count, [middle[0] * n / count[0] for n in count], "k:", linewidth=1, label="in proportion")
            axes.set_xlabel(axis)
            axes.set_ylabel("time per step [ms]")
            axes.legend(frameon=False)
        paths.append(folder / f"{group}.svg")
    return paths


def growth_points(cases: Mapping[str, CaseResult], group: str, fact: str) -> list[tuple[float, float, float, float]]:
    """Value of the fact, and median, least and largest time per step [ms]; ascending."""
    points = []
    for case in cases.values():
        if case.group == group and "step_ms" in case.figures:
            figure = case.figures["step_ms"]
            points.append((float(case.facts[fact]), figure.median, min(figure.values), max(figure.values)))
    return sorted(points)


def _figure(metric: str) -> Column:
    return lambda _, case: figure_text(case.figures.get(metric))


def _fact(name: str) -> Column:
    return lambda _, case: case.facts.get(name, NOTHING)


def _measured(results: Results, kind: str = "", group: str = "") -> list[tuple[str, CaseResult]]:
    """The measured cases of a kind or of a group, with their names."""
    return [
        (name, case)
        for name, case in results.cases.items()
        if case.figures and kind in ("", case.kind) and group in ("", case.group)
    ]


def _cases_table(results: Results, columns: Mapping[str, Column], kind: str = "", group: str = "") -> str:
    cases = _measured(results, kind, group)
    return _table(list(columns), [[column(name, case) for column in columns.values()] for name, case in cases])


def _table(header: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    if not rows:
        return "Not measured in this run."
    return "\n".join([heading(header), *map(row, rows)])


FACTORISATION_COLUMNS: dict[str, Column] = {
    "case": lambda name, _: f"`{name}`",
    "threads": lambda _, case: case.threads or "all",
    "nodes": _fact("nodes"),
    "MFLOP": lambda _, case: f"{case.facts['mflop']:.3g}",
    "taichisoft, ms": _figure("factorise_ms"),
    "CHOLMOD, ms": _figure("cholmod_ms"),
    "SuperLU, ms": _figure("superlu_ms"),
    "over CHOLMOD": _figure("ratio_to_cholmod"),
    "GFLOP/s": lambda _, case: f"{case.facts['mflop'] / case.figures['factorise_ms'].median:.1f}",
    "of a dense product": lambda _, case: f"{case.facts['dense_gflops']:.1f}",
}
GROWTH_COLUMNS: dict[str, Column] = {
    "nodes": _fact("nodes"),
    "contacts": _fact("step_contacts"),
    "sweeps": _fact("step_sweeps"),
    "ms per step": _figure("step_ms"),
    "us per node": lambda _, case: f"{1e3 * case.figures['step_ms'].median / case.facts['nodes']:.2f}",
    "displacement, mm": _fact("displacement_mm"),
    "memory, MB": _figure("peak_mb"),
}
START_COLUMNS: dict[str, Column] = {
    "case": lambda _, case: case.title,
    "import, s": _figure("import_s"),
    "model, s": _figure("model_s"),
    "first step, s": _figure("first_step_s"),
    "total, s": _figure("total_s"),
}
THROUGHPUT_COLUMNS: dict[str, Column] = {
    "processes": _fact("processes"),
    "steps of a run": _fact("steps"),
    "taichisoft, steps/s": _figure("ours_per_s"),
    "runs/min": lambda _, case: f"{60.0 * case.figures['ours_per_s'].median / case.facts['steps']:.3g}",
    "MuJoCo, steps/s": _figure("mujoco_per_s"),
    "over MuJoCo's": _figure("over_mujoco"),
}

SECTIONS: dict[str, Callable[[Results], str]] = {
    "machine": machine_lines,
    "targets": targets_table,
    "factorisation": lambda results: _cases_table(results, FACTORISATION_COLUMNS, kind="factorisation"),
    "threads": threads_table,
    "nodes": lambda results: growth_table(results, "growth_nodes"),
    "contacts": lambda results: growth_table(results, "growth_contacts"),
    "fingers": lambda results: growth_table(results, "growth_fingers"),
    "tolerance": tolerance_table,
    "time_step": time_step_table,
    "start": lambda results: _cases_table(results, START_COLUMNS, kind="start"),
    "throughput": lambda results: _cases_table(results, THROUGHPUT_COLUMNS, kind="throughput"),
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
