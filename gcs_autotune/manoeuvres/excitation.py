"""Excitation signals: normalised output as a function of normalised time, from 0 to 1 over a programme.

They are levels, a sine, a ramp, staircases, chirps, multisines, pseudo-random binary sequences (Ljung1999, section
13.3) and the push before a free decay. An option that cannot be satisfied raises :class:`UsageError`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from gcs_autotune.errors import UsageError

__all__ = ["Signal", "chirp", "decay", "full", "growing", "levels", "multisine", "prbs", "sine", "staircase"]

Signal = Callable[[float], float]
"""Function from normalised time, 0 to 1, to the fraction of the requested amplitude."""


def levels(*values: float) -> Signal:
    """Return levels of equal length, one after the other."""
    return lambda x: values[min(int(x * len(values)), len(values) - 1)]


def sine(periods: float) -> Signal:
    """Return a sine with this many periods."""
    return lambda x: math.sin(2.0 * math.pi * periods * x)


def full(x: float) -> float:
    """Return full output for any *x*."""
    return 1.0


def growing(x: float) -> float:
    """Return a ramp up to full output, which is held for the last tenth."""
    return min(x / 0.9, 1.0)


def staircase(steps: int, both: bool) -> Signal:
    """Return levels that rise to full output in equal steps and come down again. *both*: to either side."""
    up = [k / steps for k in range(steps + 1)]
    there = [*up, *reversed(up[:-1])]
    return levels(*there, *([-x for x in there[1:]] if both else []))


def chirp(options: Mapping[str, float]) -> Signal:
    """Return an exponential sine sweep, faded in and out by half a cosine."""
    seconds, first, last = options["duration"], options["f-start"], options["f-stop"]
    fade_in, fade_out = options["fade-in"], options["fade-out"]
    if fade_in + fade_out > seconds:
        raise UsageError(
            f"--fade-in {fade_in:g} s and --fade-out {fade_out:g} s together exceed --duration {seconds:g} s. Reduce "
            "them"
        )
    rate = math.log(last / first) / seconds

    def at(x: float) -> float:
        t = x * seconds
        phase = first * (math.expm1(rate * t) / rate if abs(rate) > 1e-9 else t)
        share = min(t / fade_in if fade_in else 1.0, (seconds - t) / fade_out if fade_out else 1.0, 1.0)
        return 0.5 * (1.0 - math.cos(math.pi * max(share, 0.0))) * math.sin(2.0 * math.pi * phase)

    return at


LINES = 20
"""Largest number of frequencies of a multisine, because more frequencies share the same power. Project choice."""


def multisine(options: Mapping[str, float]) -> Signal:
    """Return a multisine of equal amplitudes, with frequencies at whole multiples of one per duration and a peak of
    1.

    Schroeder's phases keep its peak low for its power (Schroeder1970).
    """
    seconds = options["duration"]
    low, high = sorted((options["f-start"], options["f-stop"]))
    first, last = max(math.ceil(low * seconds - 1e-9), 1), math.floor(high * seconds + 1e-9)
    if last < first:
        raise UsageError(
            f"no period of a frequency from {low:g} to {high:g} Hz fits into {seconds:g} s. Use a longer "
            "--duration or a higher --f-stop"
        )
    every = max(math.ceil((last - first + 1) / LINES), 1)
    lines = np.arange(first, last + 1, every, dtype=np.float64)
    phases = -math.pi * np.arange(len(lines)) * (np.arange(len(lines)) - 1.0) / len(lines)

    def plain(x: float) -> float:
        return float(np.cos(2.0 * math.pi * lines * x + phases).sum())

    peak = max(abs(plain(x)) for x in np.linspace(0.0, 1.0, 40 * int(lines[-1])).tolist())
    return lambda x: plain(min(x, 1.0)) / peak


TAPS: Mapping[int, int] = {3: 2, 4: 3, 5: 3, 6: 5, 7: 6, 9: 5, 10: 7, 11: 9}
"""Length of a shift register -> the second feedback stage that gives the longest sequence (Ljung1999, 13.3)."""


def prbs(options: Mapping[str, float]) -> Signal:
    """Return a two-level pseudo-random sequence of maximum length, each level held for at least ``shortest`` [s]."""
    bits = max(math.ceil(options["duration"] / options["shortest"]), 1)
    length = next((n for n in TAPS if 2**n - 1 >= bits), max(TAPS))
    register, bits_out = [1] * length, []
    for _ in range(bits):
        bits_out.append(2.0 * register[-1] - 1.0)
        register = [register[-1] ^ register[TAPS[length] - 1], *register[:-1]]
    return levels(*bits_out)


def decay(options: Mapping[str, float]) -> Signal:
    """Return full output at the start, followed by zero output, for a decay."""
    share = options["push"] / options["duration"]
    if share >= 1.0:
        raise UsageError(
            f"--push {options['push']:g} s is not shorter than --duration {options['duration']:g} s. Use a shorter "
            "--push"
        )
    return lambda x: 1.0 if x < share else 0.0
