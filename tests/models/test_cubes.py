"""Three equal letters of a derivative are a cube, two go with the modulus."""

from __future__ import annotations

from gcs_autotune.models import STATES, term_of
from gcs_autotune.models.coupled import kernel


def test_three_equal_letters_are_a_cube_and_two_have_a_modulus() -> None:
    r = STATES.index("r")
    assert list(term_of("N_rrr", ()).factors) == [kernel.NU + r] * 3
    assert list(term_of("N_rr", ()).factors) == [kernel.NU_SIZE + r, kernel.NU + r]
