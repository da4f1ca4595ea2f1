"""Modules that take a second or more to import and are seldom needed: imported on first use."""

from __future__ import annotations

from typing import Any

__all__ = ["scipy_signal", "scipy_stats"]


def scipy_signal() -> Any:
    """Return ``scipy.signal``, which also imports ``scipy.stats``."""
    import scipy.signal

    return scipy.signal


def scipy_stats() -> Any:
    """Return ``scipy.stats``."""
    import scipy.stats

    return scipy.stats
