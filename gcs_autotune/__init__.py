"""gcs_autotune: identify and tune ArduPilot boats and ROVs over MAVLink."""

from __future__ import annotations

__all__ = ["__version__"]

__version__ = "0.1.0"
