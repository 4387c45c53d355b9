"""The beam that swings out: what is fitted to it, and what the simulated one does."""

from pathlib import Path

import numpy as np
import pytest
from conftest import SHARED

from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.studies.ring_down import (
    LOADS,
    Swing,
    measured_swing,
    measured_swings,
    rayleigh_damping,
    simulated_swing,
)

MEASURED = SHARED / "measured" / "beam"


def oscillation(frequency: float, decay: float) -> Swing:
    time = np.arange(0.0, 2.0, 0.01)
    swinging = 5.0 + 3.0 * np.exp(-decay * time) * np.cos(2 * np.pi * frequency * time)
    return Swing.of(time, swinging, 5.0)


def test_frequency_and_decay_of_an_oscillation_are_found() -> None:
    """Of one that is exactly so, to 1e-6."""
    found = oscillation(4.3, 1.7)
    assert (found.frequency, found.decay) == (pytest.approx(4.3, rel=1e-6), pytest.approx(1.7, rel=1e-6))


def test_rayleighs_factors_are_those_of_the_decays() -> None:
    """g = a / 2 + b (2 pi f)^2 / 2 at three frequencies."""
    swings = {
        load: [oscillation(f, 1.0 + 0.0006 * (2 * np.pi * f) ** 2)] for load, f in zip(LOADS, (7, 4, 3), strict=True)
    }
    assert rayleigh_damping(swings) == (pytest.approx(2.0, rel=1e-4), pytest.approx(0.0012, rel=1e-4))


def test_a_file_that_is_no_table_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "take.csv"
    path.write_text("a,b\n1,2\n")
    with pytest.raises(BenchmarkError, match=r"take\.csv: cannot be read as a table of markers"):
        measured_swing(path)


@pytest.mark.skipif(not MEASURED.is_dir(), reason="needs the recorded takes of the beam")
def test_the_beam_rings_down_as_measured() -> None:
    """Frequency and rest within 5 %, decay within 15 % of the mean of two takes; the tip's way within 15 %.

    The way's is the root mean square over half a second, over the first peak: the phase drifts by 2 % of four periods,
    and the takes begin 4 % apart.
    """
    swings = measured_swings(MEASURED)
    takes = swings["gravity"]
    peak = float(np.mean([one.displacement[0] / one.rest for one in takes]))
    found = simulated_swing(peak, rayleigh_damping(swings), 0.5, step=1e-3)
    assert found.frequency == pytest.approx(np.mean([one.frequency for one in takes]), rel=0.05)
    assert found.frequency == pytest.approx(7.7, rel=0.05)
    assert found.rest == pytest.approx(np.mean([one.rest for one in takes]), rel=0.05)
    assert found.decay == pytest.approx(np.mean([one.decay for one in takes]), rel=0.15)
    for one in takes:
        some = one.time <= 0.5
        apart = np.interp(one.time[some], found.time, found.displacement) - one.displacement[some]
        assert np.sqrt((apart**2).mean()) < 0.15 * (one.displacement[0] - one.rest)
