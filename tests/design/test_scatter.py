"""The points that refinement looks at first."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from scipy.stats import qmc

from gcs_autotune.design.refinement import DIMENSIONS, sobol
from gcs_autotune.firmware import FIRMWARE


@pytest.mark.parametrize("dimensions", range(1, DIMENSIONS + 1))
def test_the_points_are_those_of_scipy_to_the_last_bit(dimensions: int) -> None:
    for power in (1, 5, 7):
        assert np.array_equal(sobol(dimensions, power), qmc.Sobol(dimensions, scramble=False).random_base2(power))


def test_there_are_dimensions_for_the_gains_of_every_axis() -> None:
    assert max(len(axis.gains) for firmware in FIRMWARE.values() for axis in firmware.axes.values()) <= DIMENSIONS
    with pytest.raises(ValueError, match="at most"):
        sobol(DIMENSIONS + 1, 5)


@pytest.mark.slow
def test_neither_the_command_line_nor_a_design_waits_for_scipy_stats_or_signal() -> None:
    program = (
        "import sys, gcs_autotune.cli, gcs_autotune.workflow, gcs_autotune.design\n"
        "assert not {'scipy.stats', 'scipy.signal', 'matplotlib'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", program], check=True, timeout=100)
