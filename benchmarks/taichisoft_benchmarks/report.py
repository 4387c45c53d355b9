"""What the command prints: `name.metric value`, one figure a line."""

from collections.abc import Iterator

from taichisoft_benchmarks.results import CaseResult, Results


def case_lines(name: str, case: CaseResult) -> Iterator[str]:
    """Facts and figures of a case; what follows a # is for people."""
    if case.skipped:
        yield f"# {name}: skipped: {case.skipped}"
        return
    if case.problem:
        yield f"# {name}: failed: {case.problem}"
        return
    yield f"# {name}: {case.title}"
    if case.does_not:
        yield f"# {name}: does not: {case.does_not}"
    for fact, value in case.facts.items():
        yield f"{name}.{fact} {value}"
    for metric, figure in case.figures.items():
        yield (
            f"{name}.{metric} {figure.median:.4g}"
            f"  # least {figure.minimum:.4g}, spread {figure.spread:.2g}, {len(figure.values)} runs"
        )
    for window, phases in case.phases.items():
        for phase, milliseconds in phases.items():
            yield f"{name}.{window}.{phase.replace(' ', '_')}_ms {milliseconds:.4g}"


def header_lines(machine: dict[str, str], versions: dict[str, str], load: float, meshes: str) -> Iterator[str]:
    """On what it runs."""
    yield (
        f"# {machine['system']}, {machine['processor']}, {machine['cores']} cores, {machine['memory_gb']} GB; "
        f"load {load:.2f}; Python {machine['python']}"
    )
    yield "# " + ", ".join(f"{package} {version}" for package, version in versions.items())
    yield f"# meshes: {meshes}"


def closing_lines(results: Results) -> Iterator[str]:
    """Figures of whole groups, and the load at the end."""
    for name, value in results.derived.items():
        yield f"{name} {value:.4g}"
    yield f"# load at the end {results.load['end']:.2f}"
