"""Several processes at once: all answer, and one that fails takes the others with it."""

import time

import pytest

from taichisoft_benchmarks.errors import BenchmarkError, PeerMissing
from taichisoft_benchmarks.measures import throughput

# The steps alone take a third of the time to get ready, so that a busy machine may take three times as long.
START, STEPS, PAUSE = 1.5, 10, 0.05


def prepare_pause(scene):
    time.sleep(scene)  # processes are not ready at the same time
    return lambda: time.sleep(PAUSE)


def prepare_failure(scene):
    raise ValueError("no such scene")


def prepare_missing(scene):
    raise PeerMissing("mujoco is not installed")


def test_steps_of_all_processes_count_and_their_start_does_not():
    rate = throughput._steps_per_second(prepare_pause, START, STEPS, 2)
    assert 2 * STEPS / START < rate <= 2 / PAUSE  # with the start counted it would be below the former


@pytest.mark.parametrize(
    ("prepare", "error", "message"),
    [
        (prepare_failure, BenchmarkError, "a process of several at once failed: ValueError: no such scene"),
        (prepare_missing, PeerMissing, "mujoco is not installed"),
    ],
)
def test_a_process_that_fails_is_told(prepare, error, message):
    with pytest.raises(error, match=message):
        throughput._steps_per_second(prepare, 0.0, 10, 2)
