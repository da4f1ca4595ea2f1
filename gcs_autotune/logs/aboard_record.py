"""The two dataflash messages that a script of ``gcs-autotune aboard`` writes with ``logger:write``, and its runs.

Most columns are whole numbers with a scale, because a slow link has to carry the log.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.logs.sample_store import Recording, SampleStore
from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Channel, Mark, Trial

__all__ = ["ENDS", "ROWS", "Field", "Layout", "runs_aboard", "sources_of"]

Array = NDArray[np.float64]
UNKNOWN = -32768
"""Whole number of an unknown value. An unknown position is infinite."""


class Field(NamedTuple):
    """One column: its label, its letter in FMT, its source in the sample store, and SI units per count."""

    label: str
    letter: str
    source: str
    scale: float = 1.0


class Layout(NamedTuple):
    """One message: its name and its columns."""

    name: str
    fields: tuple[Field, ...]

    @property
    def labels(self) -> str:
        """The labels as ``logger:write`` takes them."""
        return ",".join(field.label for field in self.fields)

    @property
    def logged(self) -> tuple[str, str, str]:
        """Name, labels and format letters as ``logger:write`` takes them."""
        return self.name, self.labels, "".join(field.letter for field in self.fields)


ROWS = Layout(
    "AXP",
    (
        Field("Ph", "B", "part"),
        Field("FX", "h", "X", 1e-4),
        Field("FZ", "h", "Z", 1e-4),
        Field("FN", "h", "N", 1e-4),
        Field("Yaw", "h", "psi", 1e-4),
        Field("R", "h", "r", 1e-3),
        Field("PN", "f", "x"),
        Field("PE", "f", "y"),
        Field("PD", "f", "z"),
        Field("U", "h", "u", 1e-3),
        Field("V", "h", "v", 1e-3),
        Field("W", "h", "w", 1e-3),
    ),
)
"""One row per control tick or two: part of the plan, commanded forces [fraction of full output], motion [SI, rad]."""
ENDS = Layout(
    "AXE",
    (
        Field("Ph", "B", "end.part"),
        Field("End", "B", "end.ending"),
        Field("Out", "f", "end.C"),
        Field("Xa", "f", "end.x_a"),
        Field("Ref", "f", "end.reference"),
        Field("Ns", "f", "end.noise_std"),
        Field("Sp", "f", "end.speed"),
    ),
)
"""One row at the end of each relay or step: its amplitude, hysteresis, reference, noise and speed.

``End``: 0 completed, 1 out of space, 2 ended early. (A column called ``C`` would number the instances of a sensor.)
"""


ENDINGS = ("completed", "stopped", "aborted")
FORCES, MOTIONS = ("X", "Z", "N"), ("psi", "r", "x", "y", "z", "u", "v", "w")


def sources_of(layout: Layout, columns: Mapping[str, Any]) -> dict[str, Array]:
    """Return source (``aboard.psi``) -> values (n,) in SI of the messages of *layout*.

    A column with unknown values is left out, because a sample store drops a row that has any.
    """
    found: dict[str, Array] = {}
    for field in layout.fields:
        values = np.asarray(columns[field.label], dtype=np.float64)
        known = np.isfinite(values) & ~((field.letter == "h") & (values == UNKNOWN))
        if np.all(known):
            found[f"aboard.{field.source}"] = values * field.scale
    return found


def runs_aboard(log: Recording, parts: Sequence[str], force: str, meta: Mapping[str, Any]) -> list[Trial]:
    """Return the relays and steps in the last boot of *log* that contains any, in order.

    parts : kind of each part of the script's plan, ``relay`` or ``step``. force : name of the driven force. meta : what
    to store with each run.

    Raises
    ------
    NotInformative
        The log contains none.
    """
    store = next((s for s in reversed(log.stores) if "aboard.part" in s), None)
    runs = [] if store is None else _runs_in(store, parts, force, meta)
    if not runs:
        raise NotInformative(
            "the onboard log contains no row of the script. Check the space on the vehicle's SD card, and that "
            "LOG_BACKEND_TYPE contains 1 (File)"
        )
    return runs


def _runs_in(store: SampleStore, parts: Sequence[str], force: str, meta: Mapping[str, Any]) -> list[Trial]:
    t, number = store.series("aboard.part")
    begins = np.flatnonzero(np.diff(number) < 0)  # a second experiment in one log
    begun = float(t[begins[-1] + 1]) if len(begins) else -np.inf
    ends = _ends_of(store, begun)
    runs = []
    for k, kind in enumerate(parts, start=1):
        inside = (number == 2 * k + 1) & (t >= begun)
        if np.sum(inside) < 2:
            continue
        names = parts[:k].count(kind)
        window = float(t[inside][0]), float(t[inside][-1])
        runs.append(_run(store, f"{kind}-{names}", kind, force, window, {**meta, **ends.get(2 * k + 1, {})}))
    return runs


def _ends_of(store: SampleStore, begun: float) -> dict[int, dict[str, Any]]:
    """Return the number of a part -> what its end message states."""
    columns = {f.source.removeprefix("end."): store.series(f"aboard.{f.source}") for f in ENDS.fields}
    found: dict[int, dict[str, Any]] = {}
    for i, t in enumerate(columns["part"][0]):
        if t >= begun:
            row = {name: float(values[i]) for name, (_, values) in columns.items()}
            ending = ENDINGS[min(int(row.pop("ending")), 2)]
            found[int(row.pop("part"))] = {**row, "ending": ending}
    return found


def _run(
    store: SampleStore, name: str, kind: str, force: str, window: tuple[float, float], meta: dict[str, Any]
) -> Trial:
    start, end = window
    channels: dict[str, Channel] = {}
    for source in (*MOTIONS, *FORCES):
        t, values = store.series(f"aboard.{source}")
        inside = (t >= start) & (t <= end)
        driven = source not in FORCES or source == force or bool(np.any(values[inside]))
        if np.sum(inside) > 1 and driven:
            unit = "1" if source in FORCES else SIGNALS[source][0]
            here = np.unwrap(values[inside]) if source == "psi" else values[inside]
            channels[source] = Channel(source, unit, t[inside], here)
    if "u" in channels and "v" in channels:
        u = channels["u"]
        channels["U"] = Channel("U", "m/s", u.t, np.hypot(u.values, channels["v"].values))
    switches = _switches(channels[force]) if kind == "relay" and force in channels else ()
    ending = str(meta.pop("ending", "aborted"))
    about = {"manoeuvre": kind if kind == "relay" else "helm-step", "purpose": "identification", "from_t": start}
    return Trial(name, channels, switches, ending, "flown by the autopilot's script", {**about, "force": force, **meta})


def _switches(drive: Channel) -> tuple[Mark, ...]:
    turned = np.flatnonzero(np.diff(np.sign(drive.values)) != 0.0) + 1
    return tuple(
        Mark(float(drive.t[i]), "switch", {drive.name: float(drive.values[i])})
        for i in (0, *turned)
        if drive.values[i] != 0.0
    )
