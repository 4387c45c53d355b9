"""Learn a task of taichisoft_gym: the evolution strategy CMA-ES finds the weights of a small policy.

`pip install "taichisoft[gym,studies]"`, then

    python examples/learning/learn.py Grasp out/learned --enough 115.5 --reduced gripper

trains in two processes, with reduced bodies in a third of the time, and writes into the folder `grasp.json` (the
policy), `grasp.csv` and `grasp.svg` (the learning curve), `grasp-evaluation.csv` (20 episodes that were not trained on,
with the full model, of the policy and of the scripted baseline) and `grasp.mp4` (the first of them). The last lines
tell how many of the 20 succeeded. The same seed gives the same policy, in any number of processes.
`--policy grasp.json` evaluates one without training.
"""

import argparse
import csv
import json
import multiprocessing
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from taichisoft_gym import Channel
from taichisoft_gym.baselines import POLICIES

FIRST_SEED = 10_000
"""Seeds from here on are those of the evaluation."""
SIZE = (640, 480)
RANGES = {"friction": (0.4, 0.8), "mass": (0.5, 2.0), "modulus": (0.9, 1.1), "place": 3.0}
"""What differs between episodes of the gripper, in training and evaluation, beside what the task draws."""


def by_name(channels: Sequence[Channel], readings: np.ndarray) -> dict[str, np.ndarray]:
    """Readings by the names of their channels without the last word: "pressure" [kPa], "object" [mm]."""
    found: dict[str, list[float]] = {}
    for channel, value in zip(channels, readings.tolist(), strict=True):
        found.setdefault(channel.name.rpartition(" ")[0], []).append(value)
    return {name: np.array(values) for name, values in found.items()}


def reach(weights: np.ndarray, seen: dict[str, np.ndarray]) -> np.ndarray:
    """The pressure, linear in the present one, the way from tip to target, and where the tip is."""
    about = [1.0, *(seen["pressure"] / 60.0), *(seen["way to the target"] / 10.0), *(seen["tip"] / 100.0)]
    action: np.ndarray = weights.reshape(1, 8) @ about
    return action


def grasp(weights: np.ndarray, seen: dict[str, np.ndarray]) -> np.ndarray:
    """One pressure for all fingers and a speed upwards, linear in pressure and heights of base and object."""
    about = [1.0, seen["pressure"].mean() / 100.0, seen["base"][2] / 30.0, seen["object"][2] / 30.0]
    pressure, speed = weights.reshape(2, 4) @ about
    return np.array([pressure] * len(seen["pressure"]) + [speed])


def carry(weights: np.ndarray, seen: dict[str, np.ndarray]) -> np.ndarray:
    """One pressure for all fingers and a speed upwards, by grip, height and whether the object has arrived.

    Across, the base goes to the object, and the higher that is the faster to the target.
    """
    way, pressures, lift = seen["way to the target"], seen["pressure"], np.clip(seen["object"][2] / 10.0, 0.0, 1.0)
    grip, left = pressures.mean() / 100.0, min(np.linalg.norm(way) / 5.0, 1.0)
    pressure, speed = weights[:2] @ [1.0, left], weights[2:5] @ [1.0, grip * left, seen["base"][2] / 30.0]
    across = weights[5] * lift * way / 10.0 + weights[6] * (seen["object"] - seen["base"])[:2] / 10.0
    return np.array([pressure] * len(pressures) + [*across, speed])


LEARNERS = {
    "Reach": (reach, np.zeros(8), 30),
    "Grasp": (grasp, np.zeros(8), 120),
    "Carry": (carry, np.array([-1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0]), 100),
}
"""Policies, the weights around which they are searched, and control periods of an episode of the training.

From zeros Carry-v0 learns to hold the object over its target for ever; so it begins with fingers that are open there,
and know nothing of moving."""


def make(task: str, **arguments: Any) -> Any:
    """The environment of a task; of the gripper with RANGES."""
    if task != "Reach":
        arguments["randomisation"] = RANGES
    return gymnasium.make(f"taichisoft_gym:taichisoft/{task}-v0", **arguments)


Act = Callable[[dict[str, np.ndarray]], np.ndarray]
Played = tuple[float, dict[str, Any]]


def play(environment: Any, seed: int, act: Act, watch: Callable[[], Any] = lambda: None) -> Played:
    """Play an episode; `act` makes an action of readings by name. Returns the sum of the rewards and the last info."""
    readings, info = environment.reset(seed=seed)
    total, is_over = 0.0, False
    while not is_over:
        action = act(by_name(environment.unwrapped.channels, readings))
        readings, reward, terminated, truncated, info = environment.step(np.clip(action, -1.0, 1.0).astype(np.float32))
        total, is_over = total + float(reward), terminated or truncated
        watch()
    return total, info


KEPT: dict[str, Any] = {}


def begin_worker(task: str, reduced: str | None) -> None:
    """Make the environment of a process, which keeps it."""
    KEPT[task] = make(task, reduced=reduced, max_episode_steps=LEARNERS[task][2])


def fitness(task: str, trial: tuple[np.ndarray, list[int]]) -> float:
    """Mean return of weights over episodes with some seeds."""
    weights, seeds = trial
    return float(np.mean([play(KEPT[task], seed, partial(LEARNERS[task][0], weights))[0] for seed in seeds]))


def train(told: argparse.Namespace) -> np.ndarray:
    """Find weights; writes the policy and the learning curve."""
    from cmaes import CMA

    task, folder, episodes = told.task, told.folder, told.episodes
    search = CMA(LEARNERS[task][1], told.spread, seed=told.seed, population_size=told.population)
    rows, began = [], time.monotonic()
    # Spawned: a process forked from one that has simulated cannot simulate.
    pool = multiprocessing.get_context("spawn").Pool(told.processes, begin_worker, (task, told.reduced))
    with pool:
        for generation in range(told.generations):
            seeds = [generation * episodes + number for number in range(episodes)]
            asked = [search.ask() for _ in range(search.population_size)]
            trials = [(weights, seeds) for weights in (search.mean, *asked)]
            learned, *returns = pool.map(partial(fitness, task), trials, chunksize=1)
            played = (generation + 1) * episodes * len(trials)
            rows.append((played, time.monotonic() - began, min(returns), learned, max(returns)))
            if learned < told.enough:
                search.tell([(weights, -value) for weights, value in zip(asked, returns, strict=True)])
            write_policy(folder / f"{task.lower()}.json", task, search.mean)
            write_rows(folder / f"{task.lower()}.csv", CURVE, rows)
            if learned >= told.enough:
                break
    draw_curve(task, rows, folder / f"{task.lower()}.svg")
    best: np.ndarray = search.mean
    return best


CURVE = ("episodes", "wall-clock time [s]", "worst return", "policy's return", "best return")


def write_policy(path: Path, task: str, weights: np.ndarray) -> None:
    """Write a policy as JSON."""
    path.write_text(json.dumps({"task": task, "weights": weights.tolist()}, indent=1) + "\n", encoding="utf-8")


def read_policy(path: Path) -> np.ndarray:
    """Weights of a policy that `write_policy` has written."""
    return np.array(json.loads(path.read_text(encoding="utf-8"))["weights"])


def write_rows(path: Path, header: tuple[str, ...], rows: Sequence[tuple[Any, ...]]) -> None:
    """Write a table."""
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([header, *rows])


def draw_curve(task: str, rows: Sequence[tuple[float, ...]], path: Path) -> None:
    """Draw the returns of each generation over the episodes played."""
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams["svg.hashsalt"] = "taichisoft"
    from matplotlib import pyplot

    played, _, worst, policy, best = np.array(rows).T
    figure, axes = pyplot.subplots(figsize=(7.0, 3.5), layout="constrained")
    axes.fill_between(played, worst, best, color="0.85", label="worst to best of a generation")
    axes.plot(played, policy, label="policy")
    axes.set(xlabel=f"episodes of {task}-v0", ylabel="return")
    axes.legend(loc="best", fontsize="small")
    figure.savefig(path, metadata={"Date": None})
    pyplot.close(figure)


def evaluate(task: str, folder: Path, weights: np.ndarray, episodes: int) -> None:
    """Play new episodes with the full model; film the first, and print how policy and baseline fare."""
    import imageio_ffmpeg

    environment, rows = make(task, render_mode="rgb_array", size=SIZE), []
    fps = environment.metadata["render_fps"]
    video = imageio_ffmpeg.write_frames(str(folder / f"{task.lower()}.mp4"), SIZE, fps=fps)
    video.send(None)
    for number in range(episodes):
        film = (lambda: video.send(np.ascontiguousarray(environment.render()))) if number == 0 else (lambda: None)
        total, info = play(environment, FIRST_SEED + number, partial(LEARNERS[task][0], weights), film)
        video.close()
        scripted = None

        def baseline(seen: dict[str, np.ndarray]) -> np.ndarray:
            nonlocal scripted
            scripted = scripted or POLICIES[task](environment.unwrapped)  # which begins once the target is drawn
            return next(scripted)

        other, told = play(environment, FIRST_SEED + number, baseline)
        rows.append((FIRST_SEED + number, total, info["is_success"], other, told["is_success"]))
    environment.close()
    write_rows(folder / f"{task.lower()}-evaluation.csv", ("seed", "return", "success", "baseline", "success"), rows)
    _, returns, successes, others, theirs = zip(*rows, strict=True)
    for name, sums, count in (("learned", returns, sum(successes)), ("scripted", others, sum(theirs))):
        print(f"{task}-v0, {name}: {count} of {episodes} succeed; return {np.mean(sums):.1f}")


def main() -> None:
    """Train, evaluate, and say how it went."""
    parser = argparse.ArgumentParser(description="Learn a task.")
    parser.add_argument("task", choices=list(LEARNERS))
    parser.add_argument("folder", type=Path, help="folder for the results")
    parser.add_argument("--generations", type=int, default=40)
    parser.add_argument("--enough", type=float, default=np.inf, help="mean return of the policy at which it is learned")
    parser.add_argument("--population", type=int, help="policies of a generation; else by the number of weights")
    parser.add_argument("--episodes", type=int, default=2, help="episodes of each policy of a generation")
    parser.add_argument("--spread", type=float, default=0.5, help="standard deviation of the first weights")
    parser.add_argument("--processes", type=int, default=2, help="episodes side by side")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--reduced", help="folder of `taichisoft reduce`, to train with reduced bodies")
    parser.add_argument("--trials", type=int, default=20, help="episodes of the evaluation")
    parser.add_argument("--policy", type=Path, help="a policy to evaluate, without training")
    told = parser.parse_args()
    told.folder.mkdir(parents=True, exist_ok=True)
    weights = read_policy(told.policy) if told.policy else train(told)
    evaluate(told.task, told.folder, weights, told.trials)


if __name__ == "__main__":
    main()
