"""The table of manoeuvres, by the names that records contain.

``gcs-autotune fly``, ``tune`` and ``experiment`` fly them, previews simulate them, and ``identify --plan-next`` ranks
them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from gcs_autotune.axes import EXCITATIONS
from gcs_autotune.manoeuvres import (
    free_decay,
    layered,
    open_loop,
    set_point_relay,
    spiral,
    step,
    stopping,
    turning,
    zig_zag,
)
from gcs_autotune.manoeuvres.kind import ManoeuvreKind, Preset
from gcs_autotune.manoeuvres.relay import Relay, WallRelay
from gcs_autotune.manoeuvres.relay_settings import OptionNames, RelaySettings

__all__ = ["MANOEUVRES"]


def _relay(title: str, signal: str, force: str, hysteresis: float) -> Preset:
    """Return a relay at full output that oscillates for the given time."""

    def make(seconds: float) -> Relay:
        settings = RelaySettings(signal, force, 1.0, hysteresis, periods=10**6, most_periods=10**6, patience=math.inf)
        return Relay(settings)

    return Preset(title, force, make, closed=True)


_OF_EXPERIMENT = OptionNames("--relay-output (of `experiment`)", "--relay-hysteresis (of `experiment`)")
"""Names of the two options that ``experiment`` has for a relay. `fly relay` determines both values itself."""


def _relay_of(force: str) -> ManoeuvreKind:
    """Return the row for a relay on one *force*, which determines its own size."""
    d = next(e for e in EXCITATIONS.values() if e.names.force == force)

    def make(options: Mapping[str, float]) -> Relay:
        settings = RelaySettings(
            d.signal,
            force,
            throttle=0.0 if force == "X" else options["throttle"],
            keep_still=bool(options["keep-still"]),
            least_hysteresis=d.least_hysteresis,
            names=_OF_EXPERIMENT,
        )
        return Relay(settings)

    return ManoeuvreKind(
        name="relay",
        help="relay experiment: a relay with hysteresis on heading, depth, roll, pitch, or distance ahead or to the "
        "side",
        excites=frozenset({d.dof}),
        drives=frozenset({force}),
        make=make,
        presets=(
            _relay("yaw relay", "psi", "N", math.radians(10.0)),
            _relay("heave bob", "z", "Z", 0.2),
            _relay("roll relay", "phi", "K", math.radians(3.0)),
            _relay("pitch relay", "theta", "M", math.radians(3.0)),
        ),
        room="at the spot; a boat keeps its cruise speed",
        stays=force != "N",
        for_force=_relay_of,
    )


_RELAY = _relay_of("N")


def _wall_relay(options: Mapping[str, float]) -> WallRelay:
    settings = RelaySettings(
        "d",
        "X",
        hysteresis=options["wall-hysteresis"],
        keep_still=bool(options["keep-still"]),
        least_distance=options["least-distance"],
        names=OptionNames("relay output", "--wall-hysteresis"),
    )
    return WallRelay(settings, "wall-relay")


_WALL_RELAY = ManoeuvreKind(
    name="wall-relay",
    help="relay experiment ahead and astern on the distance to a wall, from the rangefinder (DISTANCE_SENSOR)",
    excites=frozenset({"surge"}),
    drives=frozenset({"X"}),
    make=_wall_relay,
    options=("wall-hysteresis", "least-distance"),
    room="a few times the hysteresis, in front of a flat wall",
    stays=True,
    needs="d",
)
_SIGN_CHECK = ManoeuvreKind(
    name="sign-check",
    help="a pulse and a pulse back, to check that an actuator moves the craft in the right direction",
    excites=frozenset({"yaw", "heave", "surge"}),
    drives=frozenset({"N"}),
    identifies=False,
    command="most commands that fly, at their start",
)
_THROTTLE_STEPS = ManoeuvreKind(
    name="throttle-steps",
    help="throttle levels under way, each held until the speed is steady",
    excites=frozenset({"surge"}),
    drives=frozenset({"X", "N"}),
    needs_way=True,
    room="one minute of travel straight ahead",
    command="experiment surge, and tune speed",
)
_TURN_AROUND = ManoeuvreKind(
    name="turn-around",
    help="a half circle back towards the start of the last manoeuvre",
    excites=frozenset(),
    drives=frozenset({"X", "N"}),
    needs_way=True,
    identifies=False,
    room="a turning circle",
    command="commands that fly a boat twice, if space requires",
)
_DIVE = ManoeuvreKind(
    name="dive",
    help="dive from the surface with the autopilot's own depth loop",
    excites=frozenset(),
    drives=frozenset({"Z"}),
    identifies=False,
    room="1.5 m of depth",
    command="every depth manoeuvre that starts at the surface",
)
_COME_BACK = ManoeuvreKind(
    name="come-back",
    help="return to the start of the first run, with gentle steering",
    excites=frozenset(),
    drives=frozenset({"X", "N"}),
    needs_way=True,
    identifies=False,
    room="a turning circle, and the way back",
    command="fly PLAN.toml, between two runs of a boat",
)
_CALM_CHECK = ManoeuvreKind(
    name="calm-check",
    help="wait with thrust off until roll and pitch have been calm for some seconds",
    excites=frozenset(),
    drives=frozenset(),
    identifies=False,
    command="fly PLAN.toml, if the plan requires calm water",
)

MANOEUVRES: Mapping[str, ManoeuvreKind] = {
    kind.name: kind
    for kind in (
        zig_zag.KIND,
        *turning.KINDS,
        *spiral.KINDS,
        stopping.KIND,
        *open_loop.KINDS,
        set_point_relay.KIND,
        free_decay.KIND,
        *layered.KINDS,
        _RELAY,
        _WALL_RELAY,
        _THROTTLE_STEPS,
        step.KIND,
        _SIGN_CHECK,
        _TURN_AROUND,
        _DIVE,
        _COME_BACK,
        _CALM_CHECK,
    )
}
"""Name -> kind of manoeuvre. To add a manoeuvre, add a module with its class and its entry, and a line here."""
