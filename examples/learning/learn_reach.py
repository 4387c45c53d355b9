"""Learn to reach: a policy moves the tip of a finger to a target, with SAC of stable-baselines3.

`pip install "taichisoft[gym]" stable-baselines3`, then

    python examples/learning/learn_reach.py --minutes 30 --processes 2 out/learn_reach

trains for so long, and writes into the folder: `policy.zip`, `learning_curve.csv` and `learning_curve.svg` (success and
distance against simulated steps), `evaluation.csv` (20 targets that were not trained on) and `reach.mp4` (the first of
them). The last line tells how many of the 20 were reached.
"""

import argparse
import csv
import time
from pathlib import Path

import gymnasium
import numpy as np

TARGETS = 20
FIRST_SEED = 10_000
"""Seeds from here on are those of the evaluation."""
REACHED = 3.0
"""Distance at the end of an episode within which a target is reached [mm]."""
SIZE = (640, 480)


def make_environment(**arguments) -> gymnasium.Env:
    """Reach-v0 with all readings from -1 to 1, as networks want them."""
    environment = gymnasium.make("taichisoft_gym:taichisoft/Reach-v0", **arguments)
    return gymnasium.wrappers.RescaleObservation(environment, np.float32(-1.0), np.float32(1.0))


def train(folder: Path, minutes: float, processes: int, seed: int):
    """Train for some minutes, and write the policy and the learning curve."""
    from stable_baselines3 import SAC
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import SubprocVecEnv

    class Curve(BaseCallback):
        """Notes how each episode ended, and stops when the time is over."""

        def __init__(self):
            super().__init__()
            self.rows: list[tuple[float, int, float]] = []
            self.began = time.monotonic()

        def _on_step(self) -> bool:
            now = time.monotonic() - self.began
            for done, told in zip(self.locals["dones"], self.locals["infos"], strict=True):
                if done:
                    self.rows.append((now, self.num_timesteps, told["distance"]))
            return now < 60.0 * minutes

    environments = make_vec_env(
        make_environment, processes, seed=seed, vec_env_cls=SubprocVecEnv, vec_env_kwargs={"start_method": "spawn"}
    )
    curve = Curve()
    policy = SAC(
        "MlpPolicy",
        environments,
        policy_kwargs={"net_arch": [64, 64]},
        gamma=0.9,  # the tip is there within ten actions
        learning_starts=500,
        train_freq=1,
        gradient_steps=1,
        seed=seed,
        device="cpu",
    )
    policy.learn(total_timesteps=10**9, callback=curve)
    environments.close()
    policy.save(folder / "policy.zip")
    with (folder / "learning_curve.csv").open("w", newline="") as file:
        csv.writer(file).writerows([("wall-clock time [s]", "steps", "distance at the end [mm]"), *curve.rows])
    draw_curve(curve.rows, folder / "learning_curve.svg")
    return policy


def draw_curve(rows: list[tuple[float, int, float]], path: Path) -> None:
    """Draw the distance at the end of each episode, and its running mean over 20."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    if not rows:
        return
    seconds, _, distance = np.array(rows).T
    figure, axes = pyplot.subplots(figsize=(7.0, 3.5), layout="constrained")
    axes.plot(seconds / 60.0, distance, ".", markersize=2, color="0.6", label="episode", rasterized=True)
    window = min(20, len(distance))
    mean = np.convolve(distance, np.full(window, 1.0 / window), "valid")
    axes.plot(seconds[window - 1 :] / 60.0, mean, label=f"mean of {window}")
    axes.axhline(REACHED, linewidth=0.8, color="black", linestyle=":")
    axes.set(xlabel="wall-clock time [min]", ylabel="distance at the end [mm]", yscale="log")
    axes.legend()
    figure.savefig(path, dpi=150)
    pyplot.close(figure)


def evaluate(policy, folder: Path) -> int:
    """Try new targets, the first one with a camera; returns how many were reached."""
    import imageio_ffmpeg

    environment = make_environment(render_mode="rgb_array", size=SIZE)
    rows = []
    for number in range(TARGETS):
        readings, told = environment.reset(seed=FIRST_SEED + number)
        pictures, over = [], False
        while not over:
            action, _ = policy.predict(readings, deterministic=True)
            readings, _, terminated, truncated, told = environment.step(action)
            over = terminated or truncated
            if number == 0:
                pictures.append(environment.render())
        if number == 0:
            video = imageio_ffmpeg.write_frames(str(folder / "reach.mp4"), SIZE, fps=environment.metadata["render_fps"])
            video.send(None)
            for picture in pictures:
                video.send(np.ascontiguousarray(picture))
            video.close()
        rows.append((number, *np.round(told["target"], 2), round(told["distance"], 3)))
    environment.close()
    header = ("target", "x [mm]", "y [mm]", "z [mm]", "distance [mm]")
    with (folder / "evaluation.csv").open("w", newline="") as file:
        csv.writer(file).writerows([header, *rows])
    return sum(row[-1] < REACHED for row in rows)


def main() -> None:
    """Train, evaluate, and say how it went."""
    parser = argparse.ArgumentParser(description="Learn to reach.")
    parser.add_argument("folder", type=Path, help="folder for the results")
    parser.add_argument("--minutes", type=float, default=30.0, help="time to train for")
    parser.add_argument("--processes", type=int, default=2, help="environments side by side")
    parser.add_argument("--seed", type=int, default=0)
    told = parser.parse_args()
    told.folder.mkdir(parents=True, exist_ok=True)
    policy = train(told.folder, told.minutes, told.processes, told.seed)
    print(f"{evaluate(policy, told.folder)} of {TARGETS} new targets reached within {REACHED:g} mm")


if __name__ == "__main__":
    main()
