"""The tables of docs/performance.md, as Markdown."""

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from taichisoft_benchmarks.results import CaseResult, Figure, Results

TARGETS = Path(__file__).with_name("targets.toml")
PEERS = ("mujoco", "mujoco_1000", "drake")
NOTHING = "-"


def machine_lines(results: Results) -> str:
    """On what it ran."""
    machine, load = results.machine, results.load
    versions = ", ".join(f"{package} {version}" for package, version in results.versions.items())
    calibration = [value for case in results.cases.values() for value in case.calibration_ms]
    kernel = f"{min(calibration):.2f} to {max(calibration):.2f} ms" if calibration else "not measured"
    brief = "A quick look, one run of few steps: no figures to quote. " if results.quick else ""
    return (
        f"{brief}{results.started[:10]}, {machine['processor']}, {machine['cores']} cores, {machine['memory_gb']} GB, "
        f"{machine['system']}, Python {machine['python']}; load {load['start']:.2f} at the start, {load['end']:.2f} at "
        f"the end; meshes: {results.meshes}.\n{versions}.\nCalibration kernel: {kernel}."
    )


def targets_table(results: Results) -> str:
    """Every figure that has a target or a peer."""
    targets = tomllib.loads(TARGETS.read_text(encoding="utf-8"))
    rows = []
    for name, metrics in targets.items():
        for metric, about in metrics.items():
            peers = [_peer_value(results, f"{name}_{peer}", metric) for peer in PEERS]
            sofa = f"{about['sofa']:g}" if "sofa" in about else NOTHING
            target = f"{about['target']:g}" if "target" in about else NOTHING
            rows.append([about["label"], f"`{name}.{metric}`", _value(results, name, metric), target, sofa, *peers])
    header = ["case", "figure", "taichisoft", "target", "SOFA", "MuJoCo", "MuJoCo, 1000 iterations", "Drake"]
    return _table(header, rows)


def factorisation_table(results: Results) -> str:
    """Ours beside CHOLMOD and SuperLU, and what a dense product of the same arithmetic would take."""
    header = ["case", "threads", "nodes", "MFLOP", "taichisoft, ms", "CHOLMOD, ms", "SuperLU, ms"]
    header += ["over CHOLMOD", "GFLOP/s", "of a dense product"]
    rows = []
    for name, case in _measured(results, kind="factorisation"):
        facts, times = case.facts, [case.figures.get(f"{who}_ms") for who in ("factorise", "cholmod", "superlu")]
        speed = facts["mflop"] / case.figures["factorise_ms"].median
        row = [f"`{name}`", str(case.threads or "all"), str(facts["nodes"]), f"{facts['mflop']:.3g}"]
        row += [*map(_figure, times), _figure(case.figures.get("ratio_to_cholmod"))]
        rows.append([*row, f"{speed:.1f}", f"{facts['dense_gflops']:.1f}"])
    return _table(header, rows)


def threads_table(results: Results) -> str:
    """One thread and two."""
    rows = [
        [f"`{name}`", str(case.threads), metric, _figure(figure)]
        for name, case in _measured(results)
        if "threads" in case.parameter
        for metric, figure in case.figures.items()
        if metric in ("factorise_ms", "hold_ms", "step_ms")
    ]
    gains = [[f"`{name}`", "", "gain", f"{value:.3g}"] for name, value in results.derived.items() if "_gain" in name]
    return _table(["case", "threads", "figure", "value"], rows + gains)


def growth_table(results: Results, group: str) -> str:
    """The cases of a swept group; memory is of the whole process."""
    header = ["nodes", "contacts", "sweeps", "ms per step", "us per node", "displacement, mm", "memory, MB"]
    rows = []
    for _, case in _measured(results, group=group):
        nodes, step = case.facts["nodes"], case.figures["step_ms"]
        contacts, sweeps = case.facts["step_contacts"], case.facts["step_sweeps"]
        per_node = f"{1e3 * step.median / nodes:.2f}"
        bends = _fact(case, "displacement_mm")
        rows.append([str(nodes), str(contacts), str(sweeps), _figure(step), per_node, bends, _memory(case)])
    per_finger = results.derived.get(f"{group}.mb_per_finger")
    note = f"\n\nMemory of one more finger: {per_finger:.3g} MB." if per_finger is not None else ""
    return _table(header, rows) + note


def start_table(results: Results) -> str:
    """From nothing to the first step."""
    metrics = ("import_s", "model_s", "first_step_s", "total_s")
    rows = [
        [case.title, *(_figure(case.figures[metric]) for metric in metrics)]
        for _, case in _measured(results, kind="start")
    ]
    return _table(["case", "import, s", "model, s", "first step, s", "total, s"], rows)


def other_table(results: Results) -> str:
    """Meshing, rendering, recording, the web page and plug-ins."""
    rows = []
    for kind in ("meshing", "rendering", "recording", "web", "plugins"):
        for name, case in _measured(results, kind=kind):
            for metric, figure in case.figures.items():
                if not metric.endswith("_mb"):
                    rows.append([case.title, str(case.facts["nodes"]), f"`{name}.{metric}`", _figure(figure)])
    return _table(["case", "nodes", "figure", "value"], rows)


def tolerance_table(results: Results) -> str:
    """What a looser tolerance of the contact solver saves, and what it costs; the last case is the tightest."""
    cases = _measured(results, group="tuning_tolerance")
    rows = []
    for name, case in cases:
        off = max(abs(a - b) for a, b in zip(case.facts["object_mm"], cases[-1][1].facts["object_mm"], strict=True))
        facts = [str(case.facts["grasp_sweeps"]), _figure(case.figures["grasp_ms"]), f"{off:.1e}"]
        rows.append([name.removeprefix("tuning_tolerance_"), *facts])
    return _table(["tolerance, mm/s", "sweeps per step", "ms per step", "cube's place off by, mm"], rows)


def time_step_table(results: Results) -> str:
    """What a longer time step saves, and what it costs; the last case has the shortest."""
    cases = _measured(results, group="tuning_time_step")
    rows = []
    for name, case in cases:
        step = case.figures["step_ms"]
        length = float(name.removeprefix("tuning_time_step_").removesuffix("ms"))
        bends, exact = case.facts["displacement_mm"], cases[-1][1].facts["displacement_mm"]
        rows.append(
            [f"{length:g}", _figure(step), f"{step.median / length:.2g}", f"{bends:.2f}", f"{bends - exact:+.2f}"]
        )
    header = ["step, ms", "ms per step", "s per simulated second", "displacement at 0.4 s, mm", "off, mm"]
    return _table(header, rows)


def peers_table(results: Results) -> str:
    """What the other programs leave out, and how far their fingers bend beside ours."""
    rows = []
    for name, case in results.cases.items():
        peer = next((peer for peer in reversed(PEERS) if case.group.endswith(f"_{peer}")), None)
        if peer is None:
            continue
        ours = results.cases.get(name.removesuffix(f"_{peer}"))
        if case.skipped or case.problem:
            rows.append([f"`{name}`", NOTHING, NOTHING, NOTHING, case.skipped or case.problem])
            continue
        unsolved = str(case.facts.get("unsolved", NOTHING))
        bends = [_fact(ours, "displacement_mm"), _fact(case, "displacement_mm")]
        rows.append([f"`{name}`", *bends, unsolved, case.does_not])
    header = ["case", "displacement, ours, mm", "theirs, mm", "solves that stopped early", "does not"]
    return _table(header, rows)


def phases_table(results: Results) -> str:
    """Where the time of a step goes, of the cases that are no sweep: a column for each [ms]."""
    columns = {
        name: phases
        for name, case in _measured(results, kind="steps")
        for phases in case.phases.values()
        if not case.parameter
    }
    phases = list(dict.fromkeys(phase for column in columns.values() for phase in column))
    # What a case lacks would otherwise end up after the sums.
    phases.sort(key=lambda phase: phase in ("rest", "step", "of it in Python"))
    rows = [
        [phase, *(f"{column[phase]:.3f}" if phase in column else "–" for column in columns.values())]
        for phase in phases
    ]
    return _table(["ms", *(f"`{name}`" for name in columns)], rows)


def _measured(results: Results, kind: str = "", group: str = "") -> list[tuple[str, CaseResult]]:
    return [
        (name, case)
        for name, case in results.cases.items()
        if case.figures and kind in ("", case.kind) and group in ("", case.group)
    ]


def _value(results: Results, name: str, metric: str) -> str:
    """Of a case, or of a whole group."""
    case = results.cases.get(name)
    if case is not None:
        return _figure(case.figures.get(metric))
    value = results.derived.get(f"{name}.{metric}")
    return NOTHING if value is None else f"{value:.3g}"


def _peer_value(results: Results, name: str, metric: str) -> str:
    case = results.cases.get(name)
    return NOTHING if case is None else _figure(case.figures.get(metric))


def _figure(figure: Figure | None) -> str:
    """Median, with half the spread when it can be seen."""
    if figure is None:
        return NOTHING
    scatter = f" ± {figure.spread / 2:.2g}" if figure.spread > 0.005 * abs(figure.median) else ""
    return f"{figure.median:.3g}{scatter}" if abs(figure.median) < 1000 else f"{figure.median:.0f}{scatter}"


def _memory(case: CaseResult) -> str:
    figure = case.figures.get("peak_mb")
    return NOTHING if figure is None else f"{figure.median:.0f}"


def _fact(case: CaseResult | None, name: str) -> str:
    value: Any = case.facts.get(name, NOTHING) if case is not None else NOTHING
    return str(value)


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    if not rows:
        return "Not measured in this run."
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
