"""Vector environments: environments on threads of one process, which `gymnasium.make_vec` makes by default."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import partial
from typing import Any

import gymnasium
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.vector.utils import iterate

from taichisoft.runtime import available_cores, forget_launches_of_thread, run_loops_alone


class _OnThread(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment that steps on one thread; its next step or reset can begin before it is called."""

    def __init__(self, make: Callable[[], gymnasium.Env[Any, Any]], thread: ThreadPoolExecutor):
        self._thread = thread
        self._begun: Future[Any] | None = None
        super().__init__(thread.submit(make).result())

    def begin(self, action: Any, resets: bool) -> Future[Any]:
        """Begin the next step, or the reset of an episode that has ended."""
        self._begun = self._thread.submit(self.env.reset) if resets else self._thread.submit(self.env.step, action)
        return self._begun

    def drop(self) -> None:
        """Drop the result of what has begun."""
        self._begun = None

    def step(self, action: Any) -> Any:
        """Return the result of the step that has begun, or step."""
        return (self._begun or self.begin(action, resets=False)).result()

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Return the result of the reset that has begun, or reset."""
        return (self._begun or self._thread.submit(self.env.reset, seed=seed, options=options)).result()


class SoftRobotVectorEnv(SyncVectorEnv):
    """Environments that step at the same time on threads; each has the bits that it has alone.

    A kernel's launch does not hold Python's lock, so two threads take most of two cores. Models are shared, and nothing
    is sent between processes.
    """

    envs: list[_OnThread]  # type: ignore[assignment]

    def __init__(
        self,
        env_fns: Sequence[Callable[[], gymnasium.Env[Any, Any]]],
        threads: int | None = None,
        **arguments: Any,
    ):
        """Make the environments.

        Args:
            env_fns: functions that make them.
            threads: number of threads; None: one for each core, at most one for each environment.
            arguments: those of gymnasium's `SyncVectorEnv`, such as `autoreset_mode`.

        Raises:
            ValueError: `threads` is below 1.
        """
        if threads is not None and threads < 1:
            raise ValueError(f"threads = {threads}: must be 1 or more, or None for one for each core")
        count = min(len(env_fns), threads or available_cores())
        self._threads = [ThreadPoolExecutor(1, initializer=run_loops_alone) for _ in range(count)]
        super().__init__(
            [partial(_OnThread, make, self._threads[index % count]) for index, make in enumerate(env_fns)], **arguments
        )

    def step(self, actions: Any) -> Any:
        """Step all environments; arguments, result and errors are those of `SyncVectorEnv.step`."""
        over = self._autoreset_envs if self.autoreset_mode == AutoresetMode.NEXT_STEP else [False] * self.num_envs
        each = zip(self.envs, iterate(self.action_space, actions), over, strict=True)
        wait([environment.begin(action, bool(is_over)) for environment, action, is_over in each])
        try:
            return super().step(actions)
        finally:
            for environment in self.envs:
                environment.drop()

    def close_extras(self, **arguments: Any) -> None:
        """Close the environments and end the threads."""
        super().close_extras(**arguments)
        for thread in self._threads:
            thread.submit(forget_launches_of_thread).result()
            thread.shutdown()


def _make(name: str, num_envs: int = 1, **arguments: Any) -> SoftRobotVectorEnv:
    make = partial(gymnasium.make, f"taichisoft_gym:taichisoft/{name}-v0", **arguments)
    return SoftRobotVectorEnv([make] * num_envs)


grasp, reach, carry = (partial(_make, name) for name in ("Grasp", "Reach", "Carry"))
"""Make several environments of a task."""
