"""OpenCV, imported on first use."""

from __future__ import annotations

from typing import Any

from gcs_autotune.errors import UsageError

__all__ = ["opencv"]


def opencv() -> Any:
    """Return ``cv2``.

    Raises
    ------
    UsageError
        It is not installed.
    """
    try:
        import cv2
    except ImportError as error:
        raise UsageError(f"pictures need OpenCV. Run pip install 'gcs-autotune[vision]' ({error})") from None
    return cv2
