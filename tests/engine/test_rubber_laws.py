"""Laws of rubber as functions: derivatives that belong together, and the same numbers in numpy and in kernels."""

import numpy as np
import pytest

from taichisoft.mechanics.kernels.domain_deformation import for_kernels
from taichisoft.runtime import RUBBER_LAWS, kernel
from taichisoft.runtime.language import Scalars
from taichisoft.runtime.rubber_laws import SMALLEST_STRETCH

VARIABLE = np.linspace(0.3, 3.0, 50)


@pytest.mark.parametrize("name", RUBBER_LAWS)
def test_the_last_derivative_is_the_slope_of_the_first(name: str) -> None:
    """By central differences, to 1e-7 of the largest."""
    law = RUBBER_LAWS[name]
    values = np.random.default_rng(0).uniform(1.0, 3.0, len(law.coefficients))
    ahead, behind = (law.derivatives(VARIABLE + shift, *values)[0] for shift in (1e-5, -1e-5))
    last = law.derivatives(VARIABLE, *values)[-1]
    np.testing.assert_allclose(np.subtract(ahead, behind) / 2e-5, last, atol=1e-7 * np.abs(last).max() + 1e-9)


@pytest.mark.parametrize("name", RUBBER_LAWS)
def test_tension_begins_with_three_times_the_shear_modulus(name: str) -> None:
    """Of incompressible rubber E = 3 mu; by central differences, to 1e-5."""
    law = RUBBER_LAWS[name]
    given = {one: 2.5 for one in law.names}
    low, high = law.tension(given, np.array([1.0 - 1e-4, 1.0 + 1e-4]))
    assert (high - low) / 2e-4 == pytest.approx(3.0 * law.shear_modulus(given), rel=1e-5)


def test_below_the_smallest_stretch_a_sum_goes_on_as_its_parabola() -> None:
    """The slope w' at stretches of 0.04, -0.48 and -1 lies on the tangent at 0.05, to round-off."""
    law = RUBBER_LAWS["ogden"]
    first = np.array([0.04, -0.48, -1.0])
    stress = law.principal_stress({"mu1": 60.0, "alpha1": 1.3}, np.column_stack([first, np.ones(3), np.ones(3)]))
    slope, bend = law.derivatives(SMALLEST_STRETCH, 60.0, 1.3)
    # With the other stretches 1 the stress is w'(s) + w'(1) (s - 2).
    expected = slope + bend * (first - SMALLEST_STRETCH) + 60.0 * (first - 2.0)
    np.testing.assert_allclose(stress[:, 0], expected, rtol=1e-12)


def growth(x: float, rate: float) -> float:
    """A function that a law could have."""
    return rate * np.exp(rate * x)


growth_in_kernels = for_kernels(growth)


@kernel
def fill(x: Scalars, y: Scalars):
    """Fill y with `growth` of x."""
    for i in range(x.shape[0]):
        y[i] = growth_in_kernels(x[i], 0.5)


def test_functions_of_numpy_are_taichis_in_kernels() -> None:
    result = np.zeros_like(VARIABLE)
    fill(VARIABLE, result)
    np.testing.assert_allclose(result, growth(VARIABLE, 0.5), rtol=1e-14)  # type: ignore[arg-type]
