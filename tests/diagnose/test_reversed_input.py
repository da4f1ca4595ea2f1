"""An input of the sign opposite to SNAME is reported by a diagnosis as by a fit."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_autotune.identify import reversed_input
from gcs_autotune.identify.problems import plain_form
from gcs_autotune.trial import Channel, Trial


@pytest.mark.parametrize(("added", "backward"), [(-40.0, False), (40.0, True), (0.5, False)])
def test_a_negative_inertia_with_a_known_gain_is_a_reversed_input(added, backward):
    t = np.arange(0.0, 20.0, 0.1)
    columns = {"delta": ("rad", np.sign(np.sin(t))), "r": ("rad/s", np.cos(t))}
    run = Trial("zig-zag", {n: Channel(n, unit, t, values) for n, (unit, values) in columns.items()})
    form = plain_form([run], "yaw")
    result = reversed_input(form, {"N_rdot": added, "N_r": -added}, {"N_rdot": 1.0, "N_r": 1.0})
    assert (result is not None and result.slug == "reversed-input") == backward
