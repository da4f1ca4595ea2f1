"""Identify from the limit cycles of a relay and their first harmonic (IS-O, Miskovic2010, ch. 5-7).

``limit_cycle`` determines the limit cycles of a record and decides when to stop an experiment. ``iso`` identifies one
degree of freedom from one cycle, and decides the kind of drag from two cycles. ``linear_process`` identifies any linear
process, and the closed heading loop, from several cycles. ``prediction`` is the reverse: the cycle that a relay will
cause on a known model.
"""

from __future__ import annotations

from gcs_autotune.identify.relay.limit_cycle import SCATTER, LimitCycleMonitor
from gcs_autotune.identify.relay.linear_process import loop_cycles, loop_process, loop_trial
from gcs_autotune.identify.relay.prediction import PredictedCycle, predict_cycle

__all__ = [
    "SCATTER",
    "LimitCycleMonitor",
    "PredictedCycle",
    "loop_cycles",
    "loop_process",
    "loop_trial",
    "predict_cycle",
]
