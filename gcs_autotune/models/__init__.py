"""Equations of motion, as pure functions of state, input and parameters. Knows no files and no wire."""

from __future__ import annotations

from gcs_autotune.models.nomoto import Nomoto1, Nomoto2
from gcs_autotune.models.single_dof import SingleDof
from gcs_autotune.models.transfer_function import TransferFunction

__all__ = ["Nomoto1", "Nomoto2", "SingleDof", "TransferFunction"]
