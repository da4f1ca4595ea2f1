"""From what is known of the craft to a proposal: of the model identified aboard, or of the one given by file."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from gcs_autotune.design import Proposal, Spec, design, design_from
from gcs_autotune.errors import NoGainsMeetSpec
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.given import STRANGE, Given, explained
from gcs_autotune.workflow.identification import Identified
from gcs_autotune.workflow.proof import Proof
from gcs_autotune.workflow.surge_curve import reduction_of
from gcs_autotune.workflow.thrust_curve import design_with_curve
from gcs_autotune.workflow.voyage import Voyage

__all__ = ["Ruler", "design_from_file", "design_from_fit"]


@dataclass(frozen=True, slots=True, eq=False)
class Ruler:
    """What steps are judged by: the ``proof`` flown, the signal's ``noise`` and its sensor's ``grain`` (SI).

    ``jitter``: the part of the noise that moves the actuator; None: all of it.
    """

    proof: Proof
    noise: float
    grain: float
    jitter: float | None = None


def design_from_fit(voyage: Voyage, found: Identified, ruler: Ruler) -> Proposal:
    """Return gains for the model just identified, with its thrust curve where gains can be found for that."""
    tale, axis, fit = voyage.tale, voyage.axis, found.fit
    tale.say("designing")
    spec, reduction = _spec(voyage, tale.relay_speed(), ruler), reduction_of(fit)
    curved = found.curved
    if curved is not None:
        try:
            tale.proposal = voyage.think(design_with_curve, curved, axis, voyage.present, spec)
            return tale.proposal
        except NoGainsMeetSpec as error:
            tale.say(f"with the thrust curve {error}; designing without it")
            tale.fit = fit
    tale.proposal = voyage.think(design, fit.model, fit.craft_covariance, axis, voyage.present, spec, reduction)
    return tale.proposal


def design_from_file(voyage: Voyage, given: Given, flown: Trial, ruler: Ruler) -> Proposal:
    """Return gains for the model of a file, having said how much of the step just *flown* it explains."""
    tale, file = voyage.tale, given.file
    share = voyage.think(explained, given, flown)
    if not math.isnan(share):
        strange = "" if share >= STRANGE else ": is it a model of this craft, at this speed, with this full scale?"
        tale.say(f"the model '{file.name}' explains {share:.0f} % of the step just flown{strange}")
    tale.say(f"designing from the model '{file.name}'")
    spec = replace(_spec(voyage, tale.speed_of([flown]), ruler), full_scale=given.full_scale)
    tale.proposal = voyage.think(
        design_from,
        file.model,
        voyage.axis,
        voyage.present,
        spec,
        inputs=file.inputs,
        names=file.names,
        covariance=file.covariance,
    )
    for remark in tale.proposal.remarks:
        tale.say(remark.sentence)
    return tale.proposal


def _spec(voyage: Voyage, speed: float, ruler: Ruler) -> Spec:
    s, proof, flown = voyage.settings, ruler.proof, ruler.proof.settings
    speed = speed if proof.design_speed is None else proof.design_speed
    return Spec(
        kind=s.model,
        omega_0=s.omega_0,
        settling_time=s.settling_time,
        step=abs(flown.size),
        speed=speed if voyage.axis.needs_speed and speed > 0.0 else None,
        step_duration=flown.duration,
        noise_std=ruler.noise,
        jitter_std=ruler.jitter,
        quantum=ruler.grain,
        noise_bandwidth=0.5 * voyage.craft.rates.granted["ATTITUDE"].granted,
        measured=proof.measured,
        skid=voyage.craft.skid,
        throttle=voyage.throttle if voyage.present.get("MOT_VEC_ANGLEMAX", 0.0) > 0.0 else 0.0,
    )
