"""The targets of figures (figure_targets.toml), beside what was measured and what other programs took."""

import tomllib
from collections.abc import Iterator
from pathlib import Path
from statistics import median

from taichisoft_benchmarks.case_results import RepeatedMetric, Results

FILE = Path(__file__).with_name("figure_targets.toml")
OURS = "taichisoft"
PEERS = {"mujoco": "MuJoCo", "mujoco_1000": "MuJoCo, 1000 iterations", "drake": "Drake"}
"""Names of the other programs by the ends of their cases' names."""
SHARE = "of MuJoCo's time"
NOTHING = "-"


def targets_of(results: Results) -> Iterator[tuple[str, str, dict[str, str]]]:
    """Every figure that has a target or a peer, measured or not.

    Yields:
        The figure in words, its name "case.metric", and as text, "-" where there is none: what taichisoft took, the
        target, what SOFA took once, what other programs took in the same run, our share of MuJoCo's time (the median
        over the rounds, in each of which the two ran one after the other) and the target of that share.
    """
    for case, metrics in tomllib.loads(FILE.read_text(encoding="utf-8")).items():
        for metric, about in metrics.items():
            theirs = about.get("peers", metric)
            columns = {
                OURS: _value(results, case, metric),
                "target": f"{about['target']:g}" if "target" in about else NOTHING,
                "SOFA": f"{about['sofa']:g}" if "sofa" in about else NOTHING,
                **{name: _value(results, f"{case}_{peer}", theirs) for peer, name in PEERS.items()},
                SHARE: _share(results, case, metric, theirs),
                f"{SHARE}, target": f"{about['share']:g}" if "share" in about else NOTHING,
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


def _share(results: Results, case: str, metric: str, theirs: str) -> str:
    """Our figure over MuJoCo's, in words."""
    ours, mujoco = results.cases.get(case), results.cases.get(f"{case}_mujoco")
    if ours is None or mujoco is None or metric not in ours.figures or theirs not in mujoco.figures:
        return NOTHING
    pairs = zip(ours.figures[metric].values, mujoco.figures[theirs].values, strict=False)  # stopped in between
    return f"{median(one / other for one, other in pairs):.2f}"
