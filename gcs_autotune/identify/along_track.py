"""Out and back at the same throttle: what is different is the water's doing, or the wind's.

Throttle steps are flown one way and then the other. Speed is measured over ground; with a current, or a wind, from
ahead the boat is slower by it, with it from astern quicker. Half the difference is the current along the track; thrust
and drag know only the speed through the water, so it is taken off before they are fitted.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gcs_autotune.identify.result import Doubt
from gcs_autotune.trial import Trial

__all__ = ["AlongTrack", "along_track", "doubt_of", "through_water"]

OPPOSITE = math.cos(math.radians(140.0))
"""Runs whose headings differ by less are no way out and way back."""
LEAST = 0.04
"""Chosen [m/s]: about what a GPS speed is worth when it is averaged over seconds."""
SHARE = 0.03
"""Chosen: a difference below this share of the speed shifts no parameter by more than the fit's usual errors."""
SURE = 3.0
"""Standard errors that it must exceed."""
AROUND = 1.5
"""Seconds before a steady mark over which it was taken."""


@dataclass(frozen=True, slots=True)
class AlongTrack:
    """Speeds over ground [m/s] out and back, at the same throttles; ``set`` [m/s] is half their difference, positive
    when the way out was quicker, with standard error; ``heading`` [rad] of the way out.
    """

    out: float
    back: float
    error: float
    heading: float

    @property
    def set(self) -> float:
        """Half the difference [m/s]: the current along the track, or what a wind does."""
        return 0.5 * (self.out - self.back)

    @property
    def matters(self) -> bool:
        """Whether it is more than noise, and more than a trifle."""
        speed = 0.5 * (self.out + self.back)
        return abs(self.set) > max(LEAST, SHARE * abs(speed), SURE * self.error)


def along_track(trials: Sequence[Trial]) -> AlongTrack | None:
    """Compare the steady speeds of runs flown out and back; None when no two were."""
    runs = [(heading, speeds) for heading, speeds in map(_steady, trials) if speeds]
    for i, (out, first) in enumerate(runs):
        for back, second in runs[i + 1 :]:
            common = first.keys() & second.keys()
            if math.cos(out - back) < OPPOSITE and common:
                return _compared(out, [(first[level], second[level]) for level in sorted(common)])
    return None


def _steady(trial: Trial) -> tuple[float, dict[float, list[float]]]:
    """Return the mean heading [rad] at the steady marks, and throttle level -> steady speeds [m/s]."""
    speeds: dict[float, list[float]] = defaultdict(list)
    headings = []
    for mark in trial.marks:
        if mark.kind == "steady" and "psi" in trial:
            speeds[round(float(mark.detail["level"]), 6)].append(float(mark.detail["u"]))
            headings.append(trial["psi"].between(mark.t - AROUND, mark.t).values)
    psi = np.concatenate(headings) if headings else np.empty(0)
    heading = math.atan2(float(np.mean(np.sin(psi))), float(np.mean(np.cos(psi)))) if len(psi) else math.nan
    return heading, dict(speeds)


def _compared(heading: float, pairs: Sequence[tuple[list[float], list[float]]]) -> AlongTrack:
    out, back = ([float(np.mean(side)) for side in sides] for sides in zip(*pairs, strict=True))
    halves = 0.5 * (np.array(out) - np.array(back))
    again = [np.array(side) - np.mean(side) for pair in pairs for side in pair if len(side) > 1]
    scatter = float(np.sqrt(np.mean(np.concatenate(again) ** 2) * 2.0)) if again else LEAST
    between = float(np.std(halves, ddof=1)) if len(halves) > 1 else 0.0
    return AlongTrack(
        float(np.mean(out)), float(np.mean(back)), max(scatter, between) / math.sqrt(2.0 * len(halves)), heading
    )


def through_water(trial: Trial, found: AlongTrack) -> Trial:
    """Return *trial* with its ``u`` less what the set contributes to it, heading by heading."""
    u, psi = trial["u"], trial["psi"]
    headings = np.interp(u.t, psi.t, psi.values)
    still = u.values - found.set * np.cos(headings - found.heading)
    return replace(trial, channels={**trial.channels, "u": replace(u, values=still)})


def doubt_of(found: AlongTrack) -> Doubt:
    """Return the doubt that a current or wind along the track calls for, with its number."""
    comes_from = math.degrees(found.heading + (math.pi if found.set > 0.0 else 0.0)) % 360.0
    return Doubt(
        "set-along-the-track",
        f"at the same throttles it made {found.out:.2f} m/s over ground one way and {found.back:.2f} m/s the other: a "
        f"current (or wind) of {abs(found.set):.2f} m/s from {comes_from:03.0f} deg, taken off before the fit",
        "tune in slack water and little wind: what is only taken off along the track is not known across it, and a "
        "wind's force is no current",
    )
