"""From recorded runs to a model with its uncertainty.

:func:`fit` (``api.py``) is what others call, ``METHODS`` the table of methods (``methods.py``). The engine all of them
share:

================  =============================================================================================
preparation       runs made into segments; ``intake``, ``cleaning``, ``along_axis`` before it
segment           one uninterrupted stretch: signals, inputs, accuracy of its stamps
simulation        simulates a fitted model from inputs alone
simulators        simulators for a likelihood: one axis, coupled forms, forms with effects
noise             Gaussian, robust, rounded by a coarse sensor
likelihood        of parameters, effects, initial states and the shift of stamps
problem           the data and model to fit, for searches over effects; ``fitted``: the result
solution          maximum likelihood, covariance, correction for coloured residuals (``whiteness``, ``reweighting``)
stamp_correction  the autopilot loop at which an input changed; ``settled_stamps`` for methods that take stamps as exact
initial_guess     start values of a form; ``quick_fit``: estimates before any fit
delay             decides whether there is a delay: one rule for every form
doubts            reasons not to trust a fit, with cause and cure; ``outlier_run``: one of another craft
information       Fisher information of any fit on its runs, and its Cramer-Rao bounds
thrust_curve      an actuator that is weak for small commands; ``asymmetric_thrust``: weaker one way
case              input of every method; ``fit_builder``: makes a ``Fit`` of its result
result            what comes out: ``Fit``, its parameters, traces and doubts; ``free_run`` on runs not seen
================  =============================================================================================

Its users: ``axis`` (one degree of freedom: structure and delay decided), ``coupled`` (forms), ``extended`` (effects, on
a ``base_model``), ``kalman``, ``regression``, ``relay``, ``frequency``, ``open_loop``, ``plan``.
"""

from __future__ import annotations

from gcs_autotune.identify.api import fit, fit_axis, form_of, scaled_form
from gcs_autotune.identify.asymmetric_thrust import with_doubt_of_thrust
from gcs_autotune.identify.axis.form import FREE, SIGNS, Structure, derivative_names, structure_of
from gcs_autotune.identify.axis.uncertainty import cramer_rao
from gcs_autotune.identify.base_model import (
    THRUSTERS,
    base_limits,
    data_summary_of,
    fit_base,
    given_base,
    overlooked,
    plain_form,
)
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.cleaning import clean, moves, noise_of, quantum
from gcs_autotune.identify.coupled.limits import physical
from gcs_autotune.identify.coupled.one_axis import with_actuator
from gcs_autotune.identify.fitted import Fitted
from gcs_autotune.identify.free_numbers import label_of
from gcs_autotune.identify.free_run import Validation, free_run, join, residual_statistics, validate
from gcs_autotune.identify.frequency import COHERENT, FrequencyResponse, harmonic_response
from gcs_autotune.identify.information import (
    BLIND,
    FittedModel,
    Information,
    fitted_model_of,
    information_on,
    model_delay,
)
from gcs_autotune.identify.initial_guess import RecordedMotion, initial_guess_of
from gcs_autotune.identify.intake import CONTRADICTION, check_axes, clock_jump, left_out, parts_of
from gcs_autotune.identify.kalman.noisy_fit import NoisyFit, Tangent
from gcs_autotune.identify.kalman.noisy_objective import LEAST_DAMPING, LONGEST_WAVE, MOST_DAMPING
from gcs_autotune.identify.kalman.noisy_problem import NoisyProblem
from gcs_autotune.identify.kalman.process_noise import ProcessNoise
from gcs_autotune.identify.kalman.run_to_run import RunLikelihood, RunOffset, common_gain, spread_between
from gcs_autotune.identify.kalman.thinning import thinned_to
from gcs_autotune.identify.least_squares import Local, descend, inverse_of
from gcs_autotune.identify.likelihood import Limits, Objective, Residual, judged_by
from gcs_autotune.identify.method import Method
from gcs_autotune.identify.methods import METHODS
from gcs_autotune.identify.model_file import (
    ModelFile,
    load_model,
    model_document,
    model_file_of,
    save_model,
)
from gcs_autotune.identify.moved import MOVED_TOO, moved_besides, moved_too
from gcs_autotune.identify.noise import NoiseModel, gaussian_noise
from gcs_autotune.identify.open_loop.by_zigzag import nomoto_of, solve_zigzag
from gcs_autotune.identify.open_loop.readings import (
    Hold,
    LocalFit,
    Reading,
    find_holds,
    local_fit,
    mean_reading,
    rate_of,
)
from gcs_autotune.identify.open_loop.ship_log import Execute, ShipLog, find_executes, ship_log, steered
from gcs_autotune.identify.open_loop.steps import StepReading, read_steps
from gcs_autotune.identify.open_loop.zigzag_integrals import rows_of
from gcs_autotune.identify.plan import Agreement, PlanResult, load_plan, run_plan
from gcs_autotune.identify.preparation import INPUTS, prepare, prepare_as_recorded, prepare_form, signals_of
from gcs_autotune.identify.problem import Problem
from gcs_autotune.identify.regression.drive import drives_of
from gcs_autotune.identify.regression.motion import NU, GriddedMotion, motion_of
from gcs_autotune.identify.relay.iso import decide
from gcs_autotune.identify.relay.limit_cycle import SCATTER, LimitCycleMonitor, MonitorState, find_cycles
from gcs_autotune.identify.relay.linear_process import (
    experiments_needed,
    heading_loop,
    identify_process,
    loop_cycles,
    loop_process,
    loop_trial,
    process_from_response,
)
from gcs_autotune.identify.result import (
    AxisFit,
    Decision,
    Doubt,
    Fit,
    IsoEstimate,
    LimitCycle,
    Model,
    Parameter,
    Status,
    StructureFit,
    Trace,
    is_of_one_axis,
    whole_model,
)
from gcs_autotune.identify.reweighting import alternate
from gcs_autotune.identify.segment import MIN_SAMPLES, Segment, Signal, within_horizon, without_signal
from gcs_autotune.identify.simulation import extended_of, simulated
from gcs_autotune.identify.solution_doubts import reversed_input
from gcs_autotune.identify.surge import CURVE, fit_surge, set_on_the_way_back, square_of
from gcs_autotune.identify.thrust_curve import (
    DEAD_ZONE,
    QUADRATIC,
    effect_number,
    fit_thrust_curve,
    fit_with_actuator,
    pays,
    thrust_curve_told,
    unexplained,
)
from gcs_autotune.identify.whiteness import Remainder, autocorrelation, correlation_time

__all__ = [
    "BLIND",
    "COHERENT",
    "CONTRADICTION",
    "CURVE",
    "DEAD_ZONE",
    "FREE",
    "INPUTS",
    "LEAST_DAMPING",
    "LONGEST_WAVE",
    "METHODS",
    "MIN_SAMPLES",
    "MOST_DAMPING",
    "MOVED_TOO",
    "NU",
    "QUADRATIC",
    "SCATTER",
    "SIGNS",
    "THRUSTERS",
    "Agreement",
    "AxisFit",
    "Case",
    "Decision",
    "Doubt",
    "Execute",
    "Fit",
    "Fitted",
    "FittedModel",
    "FrequencyResponse",
    "GriddedMotion",
    "Hold",
    "Information",
    "IsoEstimate",
    "LimitCycle",
    "LimitCycleMonitor",
    "Limits",
    "Local",
    "LocalFit",
    "Method",
    "Model",
    "ModelFile",
    "MonitorState",
    "NoiseModel",
    "NoisyFit",
    "NoisyProblem",
    "Objective",
    "Parameter",
    "PlanResult",
    "Problem",
    "ProcessNoise",
    "Reading",
    "RecordedMotion",
    "Remainder",
    "Residual",
    "RunLikelihood",
    "RunOffset",
    "Segment",
    "ShipLog",
    "Signal",
    "Status",
    "StepReading",
    "Structure",
    "StructureFit",
    "Tangent",
    "Trace",
    "Validation",
    "alternate",
    "autocorrelation",
    "base_limits",
    "check_axes",
    "clean",
    "clock_jump",
    "common_gain",
    "correlation_time",
    "cramer_rao",
    "data_summary_of",
    "decide",
    "derivative_names",
    "descend",
    "drives_of",
    "effect_number",
    "experiments_needed",
    "extended_of",
    "find_cycles",
    "find_executes",
    "find_holds",
    "fit",
    "fit_axis",
    "fit_base",
    "fit_surge",
    "fit_thrust_curve",
    "fit_with_actuator",
    "fitted_model_of",
    "form_of",
    "free_run",
    "gaussian_noise",
    "given_base",
    "harmonic_response",
    "heading_loop",
    "identify_process",
    "information_on",
    "initial_guess_of",
    "inverse_of",
    "is_of_one_axis",
    "join",
    "judged_by",
    "label_of",
    "left_out",
    "load_model",
    "load_plan",
    "local_fit",
    "loop_cycles",
    "loop_process",
    "loop_trial",
    "mean_reading",
    "model_delay",
    "model_document",
    "model_file_of",
    "motion_of",
    "moved_besides",
    "moved_too",
    "moves",
    "noise_of",
    "nomoto_of",
    "overlooked",
    "parts_of",
    "pays",
    "physical",
    "plain_form",
    "prepare",
    "prepare_as_recorded",
    "prepare_form",
    "process_from_response",
    "quantum",
    "rate_of",
    "read_steps",
    "residual_statistics",
    "reversed_input",
    "rows_of",
    "run_plan",
    "save_model",
    "scaled_form",
    "set_on_the_way_back",
    "ship_log",
    "signals_of",
    "simulated",
    "solve_zigzag",
    "spread_between",
    "square_of",
    "steered",
    "structure_of",
    "thinned_to",
    "thrust_curve_told",
    "unexplained",
    "validate",
    "whole_model",
    "with_actuator",
    "with_doubt_of_thrust",
    "within_horizon",
    "without_signal",
]
