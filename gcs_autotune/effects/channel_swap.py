"""Channel swap: two columns carry each other's data."""

from __future__ import annotations

from itertools import combinations
from typing import ClassVar

from gcs_autotune.effects.effect import Applied, Drive, Effect, Family, Observed, Scene, columns_of

__all__ = ["ChannelSwap"]


class ChannelSwap(Effect):
    """Two columns, ``"a+b"``, carry each other's data: plugs, axes or a table's heads exchanged."""

    slug: ClassVar[str] = "channel-swap"
    family: ClassVar[Family] = "bookkeeping"
    meaning: ClassVar[str] = "two columns carry each other's data: plugs, axes or heads exchanged"
    shown_by: ClassVar[str] = "a motion answers the other channel's command; two residuals that are each other's signal"
    mistaken_for: ClassVar[tuple[str, ...]] = ("sign-error", "coriolis-coupling", "sway-yaw-coupling")
    separated_by: ClassVar[str] = "one axis at a time: push on one, rest, then on the other"

    def places(self, scene: Scene) -> tuple[str, ...]:
        """Pairs of signals of one unit, and pairs of inputs that do not merely exchange free gains."""
        signals = [(a, b) for a, b in combinations(scene.signals, 2) if scene.signals[a] == scene.signals[b]]
        inputs = [(a, b) for a, b in combinations(scene.inputs, 2) if not _alike(a, b, scene)]
        return tuple(f"{a}+{b}" for a, b in (*signals, *inputs))

    def drive(self, own: Applied, drive: Drive) -> Drive:
        """Exchange two commands."""
        a, b = columns_of(own.place)
        if a not in drive.channels or b not in drive.channels:
            return drive
        first, second = drive.channels[a], drive.channels[b]
        return drive.with_channel(a, second).with_channel(b, first)

    def observe(self, own: Applied, seen: Observed) -> Observed:
        """Exchange two signals."""
        a, b = columns_of(own.place)
        if a not in seen.signals or b not in seen.signals:
            return seen
        first, second = seen.signals[a], seen.signals[b]
        return seen.with_signal(a, second).with_signal(b, first)


def _alike(a: str, b: str, scene: Scene) -> bool:
    """Return whether the model would not notice: both inputs drive the same forces, with gains to fit."""
    form = scene.form
    pairs = [form.inputs.get(c, ()) for c in (a, b)]
    free = all(isinstance(g, str) and g.lstrip("-") in form.free for own in pairs for _, g in own)
    return free and {f for f, _ in pairs[0]} == {f for f, _ in pairs[1]}
