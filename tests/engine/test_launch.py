"""Kernels take exactly the arrays that they are annotated with: a wrong one is an error, never misread memory."""

import weakref
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from taichisoft.runtime import kernel, launch, machine_code, ti
from taichisoft.runtime.language import Scalars, Vectors, func, vec3
from taichisoft.runtime.launch import compilations_shown, forget, timed_launches


class Particles(NamedTuple):
    """A bundle of two arrays."""

    position: Vectors
    mass: Scalars


@kernel
def add_up(vectors: Vectors, factor: ti.f64, offset: ti.i32, result: Scalars):
    for i in range(result.shape[0]):
        result[i] = factor * vectors[i].sum() + offset


@kernel
def multiply(vectors: Vectors, factor: ti.f64, result: Scalars):
    for i in range(result.shape[0]):
        result[i] = factor * vectors[i][0]


def test_a_kernel_computes_with_what_it_is_given() -> None:
    vectors, result = np.arange(12.0).reshape(4, 3), np.zeros(4)
    for factor in (0.5, 2):  # the first call compiles, later ones take the short way
        add_up(vectors, factor, 7, result)
        np.testing.assert_array_equal(result, factor * vectors.sum(axis=1) + 7)


def test_signs_of_zeros_are_told_apart() -> None:
    vectors, result = np.ones((4, 3)), np.zeros(4)
    for factor in (0.0, -0.0, 0.0):
        multiply(vectors, factor, result)
        assert set(np.signbit(result).tolist()) == {factor.hex().startswith("-")}


def test_a_refused_number_leaves_no_other_behind() -> None:
    vectors, result, offset = np.ones((4, 3)), np.zeros(4), 1000
    for _ in range(2):
        add_up(vectors, 1.0, offset, result)
        with pytest.raises(TypeError):
            add_up(vectors, 2.0, None, result)
        np.testing.assert_array_equal(result, 1003.0)
    add_up(vectors, 1.0, offset, result)
    np.testing.assert_array_equal(result, 1003.0)


def test_arrays_may_change_size_between_calls() -> None:
    for count in (3, 1, 5):
        result = np.zeros(count)
        add_up(np.ones((count, 3)), 1.0, 0, result)
        np.testing.assert_array_equal(result, 3.0)


@pytest.mark.parametrize(
    "vectors",
    [np.ones((4, 3), dtype=np.int64), np.ones((4, 3), dtype=np.float32), np.ones(12), np.ones((3, 4)).T],
    ids=["integers", "single precision", "one dimension", "not contiguous"],
)
def test_an_array_of_another_kind_is_refused(vectors: np.ndarray) -> None:
    with pytest.raises(TypeError, match="add_up, vectors: must be a contiguous float64 array of 2 dimensions"):
        add_up(vectors, 1.0, 0, np.zeros(4))


def test_a_missing_argument_is_refused() -> None:
    with pytest.raises(TypeError, match="add_up takes 4 arguments, not 3"):
        add_up(np.ones((4, 3)), 1.0, 0)


def test_arrays_known_from_an_earlier_launch_are_told_apart() -> None:
    vectors, results = [np.full((4, 3), float(k)) for k in range(20)], [np.zeros(4) for _ in range(20)]
    for offset in (0, 1):  # more sets of arrays than are remembered, each twice
        for value, result in zip(vectors, results, strict=True):
            value += offset
            add_up(value, 1.0, offset, result)
    for k, result in enumerate(results):
        np.testing.assert_array_equal(result, 3.0 * (k + 1) + 1)


def test_an_array_that_reuses_the_place_of_a_dead_one_is_not_taken_for_it() -> None:
    result = np.zeros(4)
    for k in range(30):
        vectors = np.full((4 + k % 3, 3), float(k))  # freed in the next turn, unless a launch still points to it
        add_up(vectors, 1.0, 0, result)
        np.testing.assert_array_equal(result, 3.0 * k)


@func
def weighted(i: ti.i32, particles: Particles, factor: ti.f64) -> vec3:
    return factor * particles.mass[i] * particles.position[i]


@kernel
def double(factor: ti.f64, particles: Particles, result: Particles, masses: Scalars):
    for i in range(particles.mass.shape[0]):
        result.position[i] = weighted(i, particles, factor)
        result.mass[i] = masses[i]


def particles(count: int) -> Particles:
    return Particles(np.arange(3.0 * count).reshape(count, 3), np.full(count, 2.0))


def test_a_bundle_is_taken_whole_and_changed_in_place() -> None:
    for count in (4, 2, 4):
        given, result, masses = particles(count), particles(count), np.arange(float(count))
        for _ in range(2):
            double(3.0, given, result, masses)
            np.testing.assert_array_equal(result.position, 6.0 * given.position)
            np.testing.assert_array_equal(result.mass, masses)


def test_something_else_than_the_bundle_is_refused() -> None:
    with pytest.raises(TypeError, match="kernel double, particles: must be Particles, not"):
        double(1.0, (np.ones((4, 3)), np.ones(4)), particles(4), np.ones(4))


def test_an_array_of_another_kind_in_a_bundle_is_refused() -> None:
    with pytest.raises(TypeError, match="double, result_mass: must be a contiguous float64 array of 1 dimensions"):
        double(1.0, particles(4), particles(4)._replace(mass=np.ones(4, dtype=np.int32)), np.ones(4))


class Cloud(NamedTuple):
    """A bundle that holds a bundle."""

    particles: Particles
    charge: Scalars


@func
def total(cloud: Cloud, i: ti.i32) -> ti.f64:
    return cloud.particles.position[i][0] * cloud.charge[i] + cloud.particles.mass[i]


@kernel
def charge(cloud: Cloud, result: Scalars):
    for i in range(result.shape[0]):
        result[i] = total(cloud, i)


def test_a_bundle_in_a_bundle_is_taken_whole() -> None:
    cloud, result = Cloud(particles(4), np.arange(4.0)), np.zeros(4)
    charge(cloud, result)
    np.testing.assert_array_equal(result, cloud.particles.position[:, 0] * cloud.charge + cloud.particles.mass)


def test_an_array_of_another_kind_in_an_inner_bundle_is_refused() -> None:
    inner = particles(4)._replace(mass=np.ones(4, dtype=np.int32))
    with pytest.raises(TypeError, match="charge, cloud_particles_mass: must be a contiguous float64 array"):
        charge(Cloud(inner, np.ones(4)), np.zeros(4))


def test_what_is_forgotten_is_not_kept_alive() -> None:
    some, result, masses = particles(4), particles(4), np.ones(4)
    others = particles(4), particles(4), np.ones(4)
    for held in ((some, result, masses), others):
        double(1.0, *held)
    freed, kept = weakref.ref(some.position), weakref.ref(others[0].position)
    forget(some)
    del some, result, masses, others, held
    assert freed() is None
    assert kept() is not None


def test_only_the_launch_itself_is_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock stands still but for the Python around the launch; outside nobody is told of launches."""
    clock, prepare, seconds = [0.0], launch.Kernel._prepare, list[float]()

    def slow_prepare(*arguments: object) -> object:
        clock[0] += 1.0
        return prepare(*arguments)

    monkeypatch.setattr(launch.Kernel, "_prepare", slow_prepare)
    monkeypatch.setattr(launch.time, "perf_counter", lambda: clock[0])
    result = np.zeros(4)
    with timed_launches(seconds.append):
        add_up(np.ones((4, 3)), 1.0, 0, result)
    add_up(np.ones((4, 3)), 2.0, 0, result)
    assert (clock, seconds, result[0]) == ([2.0], [0.0], 6.0)


def test_a_kernel_is_named_before_it_is_compiled_and_only_then(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine_code, "kept_folder", lambda kind: tmp_path)  # where no earlier run kept it

    @kernel
    def count(result: Scalars):
        for i in range(result.shape[0]):
            result[i] = 1.0 * i

    shown, result = [], np.zeros(3)

    def show(name: str) -> None:
        shown.append((name, result.tolist()))
        raise BrokenPipeError  # a terminal that was closed does not stop the run

    with compilations_shown(show):
        count(result)
        count(result)
    assert shown == [("count", [0.0, 0.0, 0.0])]
    assert result.tolist() == [0.0, 1.0, 2.0]
