"""Format numbers: rounded to their standard error, or to a number of digits."""

from __future__ import annotations

import math

__all__ = [
    "EXACT",
    "HALF_WIDTH",
    "UNKNOWN",
    "counted",
    "format_digits",
    "format_number",
    "format_value",
    "rounded",
    "rounded_to",
]

HALF_WIDTH = 1.96
"""Half-width of a 95 % interval of a normal distribution, in standard errors."""

UNKNOWN = "?"
"""Text for NaN, an unknown number."""


EXACT, EXACT_DIGITS = 1e-12, 9
"""Relative standard error below which it is only rounding error, and the number of digits shown then. Project
choice."""


def counted(number: int, noun: str) -> str:
    """Return *number* with its *noun*: ``counted(1, "reversal")`` is ``"1 reversal"``, and 2 have an ``s``."""
    return f"{number} {noun}{'s' * (number != 1)}"


def format_value(value: float, std: float) -> str:
    """Return *value* as text, rounded to its standard error: ``format_value(0.030412, 0.00021)`` is ``"0.0304 ±
    0.0002"``.

    The error has one digit, or two if it begins with a 1, because rounding 0.0012 to 0.001 would change it by a sixth.
    An error of 0 means a fixed number, which has four digits and no ``±``. Numbers from exact data, with only rounding
    error, have no ``±`` either. An unknown error is shown as ``± ?``.
    """
    if not math.isfinite(value):
        return UNKNOWN
    if 0.0 <= std < 1e-300:
        return format_number(value)
    if 0.0 <= std < EXACT * abs(value):
        return format_number(value, EXACT_DIGITS)
    if not math.isfinite(std) or std < 0.0:
        return f"{format_number(value)} ± {UNKNOWN}"
    last = _last_digit(std)
    if last < -6 or last > 3 or max(abs(value), std) >= 1e7:
        return _in_powers_of_ten(value, std)
    return f"{rounded(value, last)} ± {rounded(std, last)}"


def _last_digit(std: float) -> int:
    exponent = math.floor(math.log10(std))
    leading = std / 10.0**exponent
    return exponent - 1 if leading < 1.95 else exponent


def _in_powers_of_ten(value: float, std: float) -> str:
    power = math.floor(math.log10(max(abs(value), std)))
    scale = 10.0**power
    last = _last_digit(std / scale)
    if power == 0:
        return f"{rounded(value, last)} ± {rounded(std, last)}"
    return f"({rounded(value / scale, last)} ± {rounded(std / scale, last)})e{power}"


def rounded(value: float, last: int) -> str:
    """Return *value* as text, rounded to the decimal place 10**last, without a minus before zeros."""
    text = f"{round(value, -last):.{max(0, -last)}f}"
    return text[1:] if text.startswith("-") and not text.strip("-0.") else text


def rounded_to(value: float, std: float) -> str:
    """Return *value* alone as text, rounded to its standard error: ``rounded_to(6.9312, 0.17)`` is ``"6.93"``."""
    both, _, power = format_value(value, std).partition(")")
    return both.partition(" ±")[0].lstrip("(") + power


_POWERS = 1e6
"""Magnitude above which a power of ten is easier to read than zeros. Project choice."""


def format_number(value: float, digits: int = 4) -> str:
    """Return *value* as text with at most *digits* significant digits and no trailing zeros; NaN is ``?``."""
    if math.isnan(value):
        return UNKNOWN
    if math.isinf(value):
        return "unlimited" if value > 0 else "-unlimited"
    text = f"{value + 0.0:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < _POWERS else text


def format_digits(value: float, digits: int) -> str:
    """Return *value* as text with exactly *digits* significant digits, for a column of one quantity:
    ``format_digits(1.2, 3)`` is ``"1.20"``. Zero and a number that is not finite are as :func:`format_number`.
    """
    if not math.isfinite(value) or value == 0.0:
        return format_number(value, digits)
    exponent = int(f"{value:.{digits - 1}e}".partition("e")[2])
    return rounded(value, exponent - digits + 1)
