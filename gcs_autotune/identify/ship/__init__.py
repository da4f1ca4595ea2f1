"""Ship manoeuvres: open-loop steps, zig-zags, and the figures ship people expect.

==============  ===============================================================================================
readings        numbers with standard errors, read off noisy samples by local polynomials
log, holds      a run as a ship's log; the pieces during which its input stands still
step_table      thesis table 4.1, and the integrals along a response it is a special case of
steps           readings of every step; ``step_model`` one model from all; ``step_evidence`` is it one story?
by_steps        the method ``step``
==============  ===============================================================================================
"""

from __future__ import annotations
