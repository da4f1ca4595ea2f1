"""What a craft answered to a short pulse one way and back: did it move, and which way?

Pure arithmetic on what was observed; :mod:`~gcs_autotune.manoeuvres.sign_check` flies the pulses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

__all__ = ["Answer", "Stretch", "answer"]

FOLLOWS = 0.5
"""Chosen: share of the commanded output that must be measured; keepers and rounding take a little of it."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """A time under one command: ``moved`` [rad or m] beyond the drift, mean measured ``output``, ``seconds``."""

    command: float
    moved: float
    output: float
    seconds: float

    @property
    def obeyed(self) -> float:
        """Share of the command found in the measured output; 1 when all of it, negative when turned round."""
        return self.output / self.command


@dataclass(frozen=True, slots=True)
class Answer:
    """Both pulses judged. ``threshold`` [rad or m] is the least motion that counts."""

    forward: Stretch
    back: Stretch
    threshold: float

    @property
    def signs(self) -> tuple[int, int]:
        """For each pulse: 1 moved as commanded, -1 the other way, 0 not to be seen."""
        return self._sign(self.forward), self._sign(self.back)

    @property
    def is_right(self) -> bool:
        """Whether both pulses moved it as commanded."""
        return self.signs == (1, 1)

    @property
    def is_reversed(self) -> bool:
        """Whether what was seen of it is the wrong way round."""
        return self.signs in ((-1, -1), (-1, 0), (0, -1))

    @property
    def is_silent(self) -> bool:
        """Whether neither pulse moved it."""
        return self.signs == (0, 0)

    @property
    def unheeded(self) -> Stretch | None:
        """The pulse that did not reach the outputs, if one did not."""
        return next((s for s in (self.forward, self.back) if not s.obeyed >= FOLLOWS), None)

    def _sign(self, stretch: Stretch) -> int:
        if abs(stretch.moved) < self.threshold:
            return 0
        return 1 if stretch.moved * stretch.command > 0.0 else -1


def answer(
    command: float,
    rest: Sequence[tuple[float, float, float]],
    forward: Sequence[tuple[float, float, float]],
    back: Sequence[tuple[float, float, float]],
    threshold: float,
) -> Answer:
    """Judge a pulse of *command* [fraction of full] and one of ``-command``.

    rest, forward, back : (time [s], position [rad or m], measured output) per tick, before and during each pulse. What
    the craft drifted while left alone is taken off.
    """
    t, x, idle = (np.array(column) for column in zip(*rest, strict=True))
    drift = float(np.polyfit(t - t[0], x, 1)[0]) if len(t) > 2 and t[-1] > t[0] else 0.0
    bias = float(np.mean(idle))
    return Answer(
        _stretch(command, forward, drift, bias), _stretch(-command, back, drift, bias), threshold=abs(threshold)
    )


def _stretch(command: float, ticks: Sequence[tuple[float, float, float]], drift: float, bias: float) -> Stretch:
    t, x, output = (np.array(column) for column in zip(*ticks, strict=True))
    seconds = float(t[-1] - t[0])
    late = output[len(output) // 2 :]
    return Stretch(command, float(x[-1] - x[0]) - drift * seconds, float(np.mean(late)) - bias, seconds)
