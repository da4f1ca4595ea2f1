"""Effects: submodels that extend a plain simulation, by family, one class each.

==================  ==================================================================================================
effect              the interface of an effect: its hooks, and their arguments
summary             data on the runs that is available before any effect is fitted, and sizes for start values
table               the table of all effects
extended            a coupled model with effects: simulation with sensitivities, model file
data_errors         clocks, units, signs, columns
actuator            static curves and backlash; actuator_dynamics: delay, lag, rate; inflow; command_coupling
hydrodynamics       drag, couplings, mass, buoyancy, the bottom
velocity_products   forces proportional to products of velocities: the family of hydrodynamic terms
environment         constant force, current, wind, tether; wave_disturbance
sensor              position, compass, gyro, delayed reports; sensor_noise: rounding, outliers
kernels             compiled: motion between stamps; narrow_band: the filter of waves
==================  ==================================================================================================
"""

from __future__ import annotations

from gcs_autotune.effects.actuator import SUBTRACTED, Characteristic, horizon
from gcs_autotune.effects.effect import (
    INPUT,
    SIGNAL,
    Drive,
    Effect,
    EffectCurve,
    EffectInstance,
    EffectResidual,
    Family,
    Observed,
    Quantity,
    columns_of,
)
from gcs_autotune.effects.extended import STEP, ExtendedModel, ExtendedSimulator, Passage, in_order, passage_of
from gcs_autotune.effects.narrow_band import rung
from gcs_autotune.effects.sensor_noise import grid_step
from gcs_autotune.effects.summary import DataSummary, force_unit
from gcs_autotune.effects.table import (
    CRAFT,
    EFFECTS,
    effect_at,
    effect_words,
    limit_sentence,
    may_be_none,
    parameter_words,
    usual_bounds,
)
from gcs_autotune.effects.velocity_products import (
    VELOCITY_PRODUCT,
    ProductTerm,
    name_of,
    product_terms,
    term_named,
    twins_of,
)

__all__ = [
    "CRAFT",
    "EFFECTS",
    "INPUT",
    "SIGNAL",
    "STEP",
    "SUBTRACTED",
    "VELOCITY_PRODUCT",
    "Characteristic",
    "DataSummary",
    "Drive",
    "Effect",
    "EffectCurve",
    "EffectInstance",
    "EffectResidual",
    "ExtendedModel",
    "ExtendedSimulator",
    "Family",
    "Observed",
    "Passage",
    "ProductTerm",
    "Quantity",
    "columns_of",
    "effect_at",
    "effect_words",
    "force_unit",
    "grid_step",
    "horizon",
    "in_order",
    "limit_sentence",
    "may_be_none",
    "name_of",
    "parameter_words",
    "passage_of",
    "product_terms",
    "rung",
    "term_named",
    "twins_of",
    "usual_bounds",
]
