"""The report of ``navigate``: constants of the sensors, their noise, consistency, and the autopilot's own estimator."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from gcs_autotune.report.toolkit.document import IN_RESULT, Document, Note, Part, Remark, Section, Table
from gcs_autotune.report.toolkit.wording import (
    format_number,
    format_seconds,
    format_value,
    listed,
    pretty_unit,
    to_people,
)
from gcs_autotune.sname import SIGNALS

__all__ = ["navigation_document"]

CONSISTENT = (0.7, 1.4)
"""Range of the mean squared normalised innovation that counts as consistent. Project choice."""
MANY = 0.02
"""Fraction of skipped samples of a sensor above which a doubt is shown. Project choice."""

Told = Mapping[str, Any]


def navigation_document(told: Told) -> Document:
    """Return the report of a navigated log, from the plain data of its solutions."""
    sections = []
    for number, solution in enumerate(told["solutions"], start=1):
        which = f" of stretch {number}" if len(told["solutions"]) > 1 else ""
        sections.append(
            Section(f"navigation-{number}", f"Navigation{which}", tuple(_stretch(solution)), facts=IN_RESULT)
        )
    if told["autopilot_rms_difference"]:
        sections.append(Section("autopilot", "Beside the autopilot's estimator", tuple(_beside(told)), facts=IN_RESULT))
    return Document(
        title=f"Navigation solution of {told['source']}",
        sections=tuple(sections),
        doubts=tuple(_doubts(told)) or None,
        doubted="navigation solution",
        facts=told,
    )


def _stretch(solution: Told) -> Iterator[Part]:
    length = format_seconds(solution["to"] - solution["from"])
    yield Note(f"{length} at the centre of gravity, {solution['samples']} samples.")
    yield Note(_consistency(solution))
    rows = tuple((name, *_quantity(std, SIGNALS[name].unit)) for name, std in solution["mean_std"].items())
    yield Table(("signal", "mean std", "unit"), "lrl", rows)
    yield Table(("constant", "value ± std", "unit", ""), "lrll", tuple(_constants(solution)))
    yield Table(
        ("sensor", "used", "skipped", "noise", "NIS"),
        "lrrrr",
        tuple(
            (name, str(s["used"]), str(s["skipped"]), format_number(s["sigma"], 2), format_number(s["nis"], 2))
            for name, s in solution["sensors"].items()
        ),
        note="Noise in SI units. NIS: mean squared innovation over its variance, 1 if the covariance is right.",
    )


def _consistency(solution: Told) -> str:
    nis = solution["nis"]
    if CONSISTENT[0] <= nis <= CONSISTENT[1]:
        verdict = "agree with"
    else:
        verdict = "are larger than" if nis > 1.0 else "are smaller than"
    return f"The innovations {verdict} their covariance: mean NIS {format_number(nis, 2)}, expected 1."


def _constants(solution: Told) -> Iterator[tuple[str, ...]]:
    for name, constant in solution["constants"].items():
        unit, factor = to_people(constant["unit"])
        doubt = "" if constant["determined"] else "not determined by this log"
        yield name, format_value(constant["value"] * factor, constant["std"] * factor), pretty_unit(unit), doubt


def _beside(told: Told) -> Iterator[Part]:
    rows = tuple(
        (name, *_quantity(rms, SIGNALS[name].unit if name in SIGNALS else "m/s"))
        for name, rms in told["autopilot_rms_difference"].items()
    )
    yield Table(("signal", "rms difference", "unit"), "lrl", rows)
    yield Note(
        "The autopilot's estimator uses past samples only and no estimated delays, and its velocity is that of its "
        "board. The difference contains the errors of both. Constant differences of x, y and z are left out, because "
        "the origins differ."
    )


def _doubts(told: Told) -> Iterator[Remark]:
    if told["not_determined"]:
        yield Remark(
            f"{listed(told['not_determined'])} are left out, because the log contains no usable GPS or DVL. Roll and "
            "pitch assume that the speed stays below about 1 m/s",
            "note",
        )
    for name, stretches in told["stuck"].items():
        when = listed([f"from {start:.1f} to {end:.1f} s" for start, end in stretches])
        yield Remark(f"{name} did not change {when}. These samples were left out. If the craft moved, check the sensor")
    for solution in told["solutions"]:
        if solution["nis"] > CONSISTENT[1]:
            yield Remark(f"{_consistency(solution)} The true errors are probably larger than the standard deviations")
        if solution["nis"] < CONSISTENT[0]:
            yield Remark(f"{_consistency(solution)} The standard deviations are probably too large", "note")
        if not solution["converged"]:
            yield Remark(
                f"noise levels and delays still changed after {solution['passes']} passes. Record a longer stretch "
                "with more turns and changes of speed"
            )
        for name, sensor in solution["sensors"].items():
            total = sensor["used"] + sensor["skipped"]
            if sensor["skipped"] > MANY * total:
                yield Remark(f"{sensor['skipped']} of {total} samples of {name} were skipped as outliers")


def _quantity(value: float, unit: str) -> tuple[str, str]:
    shown, factor = to_people(unit)
    return format_number(value * factor, 2), pretty_unit(shown)
