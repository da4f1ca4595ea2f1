"""Equations of motion, as pure functions of state, input and parameters. They access no logs and no network."""

from __future__ import annotations

from gcs_autotune.models.coupled import FORMS, CoupledModel, Form, Simulator, form_from, load_form, unit_of
from gcs_autotune.models.coupled.compass import COEFFICIENTS
from gcs_autotune.models.coupled.derivatives import (
    DEPTH,
    FORCES,
    PAYLOAD,
    PAYLOADS,
    RIGID_BODY,
    SEEN,
    SPECIAL,
    STATES,
    WALLS,
    Term,
    inertia_of,
    term_of,
)
from gcs_autotune.models.coupled.kernel import (
    COS_PSI,
    ETA,
    INPUT,
    INPUT_SIZE,
    NEAR,
    NU_SIZE,
    SIN_PHI,
    SIN_PSI,
    SIN_THETA,
    Program,
    Scratch,
    carry,
    scratch,
)
from gcs_autotune.models.coupled.lever_arm import LEVER_ARM, SHOWN_OFF_CENTRE, seen_off_centre
from gcs_autotune.models.coupled.program import inertia_matrix, program_of, states_of
from gcs_autotune.models.coupled.regressors import Balance, balance_of, force_columns, inertia_columns
from gcs_autotune.models.nomoto import Nomoto1, Nomoto2
from gcs_autotune.models.simulation import explicit_parameters, simulate, simulate_explicit
from gcs_autotune.models.single_dof import SingleDof
from gcs_autotune.models.transfer_function import TransferFunction

__all__ = [
    "COEFFICIENTS",
    "COS_PSI",
    "DEPTH",
    "ETA",
    "FORCES",
    "FORMS",
    "INPUT",
    "INPUT_SIZE",
    "LEVER_ARM",
    "NEAR",
    "NU_SIZE",
    "PAYLOAD",
    "PAYLOADS",
    "RIGID_BODY",
    "SEEN",
    "SHOWN_OFF_CENTRE",
    "SIN_PHI",
    "SIN_PSI",
    "SIN_THETA",
    "SPECIAL",
    "STATES",
    "WALLS",
    "Balance",
    "CoupledModel",
    "Form",
    "Nomoto1",
    "Nomoto2",
    "Program",
    "Scratch",
    "Simulator",
    "SingleDof",
    "Term",
    "TransferFunction",
    "balance_of",
    "carry",
    "explicit_parameters",
    "force_columns",
    "form_from",
    "inertia_columns",
    "inertia_matrix",
    "inertia_of",
    "load_form",
    "program_of",
    "scratch",
    "seen_off_centre",
    "simulate",
    "simulate_explicit",
    "states_of",
    "term_of",
    "unit_of",
]
