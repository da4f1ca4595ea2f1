"""The next control tick, and everything known of the craft at it."""

from __future__ import annotations

from gcs_autotune.craft import Observation
from gcs_autotune.errors import TelemetryFault
from gcs_autotune.link.session import Session
from gcs_autotune.link.telemetry import Telemetry

__all__ = ["await_tick", "observation"]

_TICK_TIMEOUT = 3.0
_UNHEARD = 2.0
"""Chosen: seconds without a word, two heartbeats, after which missing attitudes are the link's fault."""


def await_tick(session: Session, telemetry: Telemetry) -> None:
    """Pump until the next ATTITUDE.

    Raises
    ------
    LinkLost, OperatorStopped
        From the session.
    TelemetryFault
        NaN, frozen or jumping telemetry; or no attitude although the vehicle is heard.
    """
    seen, begun = telemetry.ticks, session.listened
    while telemetry.ticks == seen:
        telemetry.watchdog.check()
        if session.listened - begun > _TICK_TIMEOUT:
            session.check_heard(_UNHEARD)
            raise TelemetryFault(
                f"no usable ATTITUDE for {_TICK_TIMEOUT:g} s although the vehicle is heard; is another "
                "ground station changing the stream rates?"
            )
        session.pump()
    telemetry.watchdog.check()


def observation(session: Session, telemetry: Telemetry, mode: str) -> Observation:
    """Return what is known now of a craft in *mode*."""
    value = telemetry.value
    return Observation(
        t=telemetry.t,
        psi=value("psi"),
        r=value("r"),
        phi=value("phi"),
        theta=value("theta"),
        x=value("x"),
        y=value("y"),
        z=value("z"),
        u=value("u"),
        v=value("v"),
        w=value("w"),
        speed=value("U"),
        output=telemetry.outputs,
        output_t=telemetry.output_t,
        armed=session.armed,
        mode=mode,
        battery_voltage=value("battery"),
        battery_remaining=value("battery_remaining"),
        age=session.silence,
    )
