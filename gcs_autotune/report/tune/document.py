"""The report of a tune, with one function per section."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import PurePath

from gcs_autotune.design import Proposal
from gcs_autotune.report.toolkit.axis_fit import (
    cycle_table,
    damping_parts,
    estimate_table,
    explained_sentence,
    model_sentences,
    model_table,
    model_words,
)
from gcs_autotune.report.toolkit.document import (
    IN_RESULT,
    Document,
    KeyFigure,
    Note,
    Part,
    Section,
    Table,
    bullets,
    cautions,
    files_section,
    notes,
    resume_section,
    sections_of,
)
from gcs_autotune.report.toolkit.wording import (
    UNKNOWN,
    format_change,
    format_moment,
    format_percent,
    format_quantity,
    format_share,
    how_to_resume,
    remarks,
    sentence,
)
from gcs_autotune.report.tune.data import summarise
from gcs_autotune.report.tune.figures import (
    bode_figure,
    fit_figures,
    model_figures,
    relay_figures,
    route_figure,
    stays_figure,
    step_figure,
    track_figure,
)
from gcs_autotune.report.tune.story import TuneStory
from gcs_autotune.report.tune.tables import (
    beside_table,
    changed_parameters,
    gains_table,
    margins_table,
    metrics_table,
    position_table,
    rates_table,
    route_table,
    thrust_table,
    vehicle_table,
)
from gcs_autotune.report.tune.wording import (
    PROOF_SENTENCE,
    bound_sentence,
    follows,
    proof_command,
    safety,
    settling_cell,
    undo_command,
    undo_sentence,
    verdict_of,
)

__all__ = ["tune_document"]

MOST_PARAMETERS = 24
"""Largest number of parameters listed without folding them. Project choice."""


def tune_document(story: TuneStory) -> Document:
    """Return the report of a tune, as far as the tune was completed. Its JSON form is ``summary.json``."""
    fit, craft = story.fit, _craft(story)
    doubts = (*cautions(story.doubts), *(() if fit is None else remarks(fit.doubts)))
    return Document(
        title=f"{story.title[:1].upper()}{story.title[1:]}{f' of {craft}' if craft else ''}: {story.ending}",
        about=(str(story.vehicle.get("name", "vehicle not identified")),),
        when=format_moment(story.when),
        badge="simulated vehicle" if story.vehicle.get("simulated", False) else "",
        verdict=verdict_of(story),
        key_figures=tuple(_key_figures(story)),
        doubts=doubts if doubts or fit is not None else None,
        sections=sections_of(FRONT, SECTIONS, story),
        facts=summarise(story),
    )


def _craft(story: TuneStory) -> str:
    """Return the name of a simulated vehicle, otherwise that of the firmware: MAVLink has no name of the craft."""
    kind, _, name = str(story.vehicle.get("link", "")).partition(":")
    if kind == "sitl" and name:
        return PurePath(name.partition("?")[0]).stem
    return str(story.vehicle.get("firmware", ""))


def _key_figures(story: TuneStory) -> Iterator[KeyFigure]:
    before, after, source = story.metrics_before, story.metrics_after, "measured"
    if story.proposal is not None and (before is None or after is None):
        before, after, source = story.proposal.before.metrics, story.proposal.after.metrics, "predicted"
    if before is not None and after is not None:
        yield KeyFigure(format_change(before.itae, after.itae) or UNKNOWN, "tracking error", source)
        yield KeyFigure(format_share(after.overshoot), "overshoot", f"{source}, was {format_share(before.overshoot)}")
        yield KeyFigure(settling_cell(after), "settling time", f"{source}, was {settling_cell(before)}")
    if story.proposal is not None:
        worst = story.proposal.worst_margins
        margin = format_quantity(worst.phase, "rad", 2) if worst.stable else "unstable"
        yield KeyFigure(margin, "phase margin", "worst case")
    if story.fit is not None:
        yield KeyFigure(format_percent(story.fit.fit_percent), "model fit", "free run")


def _line(story: TuneStory) -> Iterator[Section]:
    if story.track_before is None:
        return
    parts: tuple[Part, ...] = (
        route_figure(story),
        route_table(story.track_before, story.track_after),
        Note("The distance is that from the leg under way or the one before it, whichever is nearer.", kind="quiet"),
    )
    yield Section("line", "Mission before and after", parts, facts=IN_RESULT)


def _position(story: TuneStory) -> Iterator[Section]:
    if story.position_before is None:
        return
    parts: tuple[Part, ...] = (
        stays_figure(story),
        position_table(story.position_before, story.position_after),
        Note("Distances are of positions averaged over one second.", kind="quiet"),
    )
    yield Section("position", "Position before and after", parts, facts=IN_RESULT)


def _thrust(story: TuneStory) -> Iterator[Section]:
    if story.thrust_before is None:
        return
    note = "Thrust is relative to the best proportional one. The commands are those that the weaker direction can give."
    parts: tuple[Part, ...] = (thrust_table(story.thrust_before, story.thrust_after), Note(note, kind="quiet"))
    yield Section("thrust", "Thrust at each command", parts, facts=IN_RESULT)


def _step(story: TuneStory) -> Iterator[Section]:
    if story.missions or story.stays:
        return
    measured = metrics_table(story.metrics_before, story.metrics_after)
    beside = "The same gains also control turn rate. This turn-rate step was flown with the old and the new gains."
    parts: tuple[Part, ...] = (
        *step_figure(story),
        measured,
        Note(beside if story.beside is not None else ""),
        beside_table(story),
    )
    is_compared = measured.rows and story.metrics_after is not None
    yield Section("step", "Step before and after" if is_compared else "Step", parts, facts=IN_RESULT)


def _gains(story: TuneStory) -> Iterator[Section]:
    proposal = story.proposal
    if not story.changes and proposal is None:
        return
    parts: list[Part] = [gains_table(story.changes)]
    if proposal is not None and story.metrics_after is None:
        parts.append(_predicted(proposal))
    yield Section("gains", "Gains", tuple(parts), facts=IN_RESULT)


def _predicted(proposal: Proposal) -> Section:
    table = metrics_table(proposal.before.metrics, proposal.after.metrics)
    return Section("gains-predicted", "Prediction of the model", (table,), detail=True)


def _reasons(story: TuneStory) -> Iterator[Section]:
    """Yield the comparison that decided whether the new values were kept.

    The terminal shows it only if they were not, because the tables contain the rest.
    """
    title = f"Comparison of old and new {'parameters' if story.missions else 'gains'}"
    parts = tuple(bullets(story.verdict_reasons))
    yield Section("reasons", title, parts, detail=bool(story.kept), facts=IN_RESULT)


def _design(story: TuneStory) -> Iterator[Section]:
    proposal = story.proposal
    if proposal is None:
        return
    how = f"{follows(proposal)} The range is from the firmware's documentation."
    notes = (Note(sentence(note)) for note in proposal.notes)
    predicted = () if story.metrics_after is None else (_predicted(proposal),)
    yield Section("design", "Design", (Note(how, kind="quiet"), *notes, *predicted), detail=True, facts=IN_RESULT)


def _proof(story: TuneStory) -> Iterator[Section]:
    if story.awaits_proof and story.proving:
        command = Note(proof_command(story), PROOF_SENTENCE, kind="command")
        yield Section("proof", "How to apply and test the new gains", (command,), facts=IN_RESULT)


def _resume(story: TuneStory) -> Iterator[Section]:
    """Yield the command that continues an interrupted tune."""
    how = how_to_resume(story.way_on)
    if how:
        yield resume_section(how["command"], how["text"])


def _undo(story: TuneStory) -> Iterator[Section]:
    """Yield the command that restores the old parameters. On the terminal it is shown only if new gains stay."""
    if story.parameters_before:
        command = Note(undo_command(story), undo_sentence(story), kind="command")
        yield Section("undo", "How to undo", (command,), detail=story.ending != "kept", facts=IN_RESULT)


def _model(story: TuneStory) -> Iterator[Section]:
    fit = story.fit
    if fit is None:
        return
    how = (
        "alpha · acceleration + (beta + beta₂ · |rate|) · rate = actuator + delta. "
        f"Identified by {fit.method} from {', '.join(fit.used)}. The numbers are rounded to their standard error."
    )
    parts: tuple[Part, ...] = (
        Note(explained_sentence(fit.fit_percent)),
        *notes(model_sentences(fit)),
        model_table(fit),
        *model_figures(story),
        Note(how, kind="quiet"),
        Section("damping", "Choice of damping", damping_parts(fit)),
    )
    second, of = story.second_fit, "" if story.second_fit is None else f" of {fit.dof}"
    yield Section("model", f"Model{of}: {model_words(fit)}", parts, detail=True, facts=IN_RESULT)
    if second is not None:
        used = f"Identified by {second.method} from {', '.join(second.used)}. It is in model-{second.dof}.json."
        parts = (
            Note(explained_sentence(second.fit_percent)),
            *notes(model_sentences(second)),
            model_table(second),
            Note(used, kind="quiet"),
        )
        title = f"Model of {second.dof}: {model_words(second)}"
        yield Section("model-second", title, parts, detail=True, facts=IN_RESULT)


_HOW_TO_READ_CYCLES = (
    "The first-harmonic estimate (IS-O) assumes sinusoidal motion. It starts the refined fit, which uses every sample. "
    "In an IS-O row the two damping columns are alternatives."
)


def _relays(story: TuneStory) -> Iterator[Section]:
    fit = story.fit
    heading = "Throttle steps" if story.experiment_signals.position == "u" else "Relay experiments"
    parts: list[Part] = list(relay_figures(story))
    if parts and fit is not None and fit.iso:
        estimates = (estimate_table(fit), Note(_HOW_TO_READ_CYCLES, kind="quiet"))
        parts.append(Section("relay-cycles", "Limit cycles", (cycle_table(fit),)))
        parts.append(Section("relay-estimates", "First-harmonic estimate and refined fit", estimates))
    yield Section("relay", heading, tuple(parts), detail=True, facts=IN_RESULT)


def _fit(story: TuneStory) -> Iterator[Section]:
    yield Section("fit", "Model and measurement", tuple(fit_figures(story)), facts=IN_RESULT)


def _margins(story: TuneStory) -> Iterator[Section]:
    proposal = story.proposal
    if proposal is not None:
        bound = Note(bound_sentence(proposal.bound), kind="quiet")
        parts: tuple[Part, ...] = (Note(safety(proposal)), margins_table(proposal), *bode_figure(story), bound)
        yield Section("margins", "Stability", parts, detail=True, facts=IN_RESULT)


def _track(story: TuneStory) -> Iterator[Section]:
    if story.missions or story.stays:
        return
    yield Section("track", "Track", (track_figure(story),), facts=IN_RESULT)


def _vehicle(story: TuneStory) -> Iterator[Section]:
    parts: tuple[Part, ...] = (
        vehicle_table(story.vehicle),
        Section("rates", "Message rates", (rates_table(story.rates),)),
        Section("announced", "Announced before the start", tuple(bullets(story.announced))),
    )
    yield Section("vehicle", "Vehicle and link", parts, detail=True, facts=IN_RESULT)


def _events(story: TuneStory) -> Iterator[Section]:
    rows = tuple(("" if math.isnan(t) else f"{t:.1f} s", text) for t, text in story.events)
    clock = Note("All times are on the vehicle's clock." if rows else "", kind="quiet")
    yield Section("events", "Events", (Table(("", ""), "rl", rows), clock), detail=True, facts=IN_RESULT)


def _parameters(story: TuneStory) -> Iterator[Section]:
    table = changed_parameters(story, MOST_PARAMETERS)
    yield Section("parameters", "Parameters before and after", (table,), detail=True, facts=IN_RESULT)


def _files(story: TuneStory) -> Iterator[Section]:
    yield from files_section(story.directory, story.files)


FRONT = (_resume, _gains, _line, _position, _thrust, _step, _proof, _undo)
"""Functions that return the sections that a reader sees first: how to continue, what changed, the one figure, and how
to undo it.
"""

SECTIONS = (_reasons, _design, _model, _relays, _fit, _margins, _track, _vehicle, _events, _parameters, _files)
"""Functions that return all other sections, folded on the page. To add a section, add its function here."""
