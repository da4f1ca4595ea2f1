"""Equations of motion, as pure functions of state, input and parameters. Knows no files and no wire."""

from __future__ import annotations

from gcs_autotune.models.single_dof import SingleDof

__all__ = ["SingleDof"]
