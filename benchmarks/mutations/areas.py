"""What matters, by area, and the faults that are none."""

from __future__ import annotations

__all__ = ["AREAS", "EQUIVALENT"]

AREAS: dict[str, tuple[str, ...]] = {
    "safety": (
        "gcs_autotune/manoeuvres/pulse_response.py",
        "gcs_autotune/manoeuvres/envelope.py",
        "gcs_autotune/manoeuvres/sequencer.py",
        "gcs_autotune/manoeuvres/sign_check.py",
        "gcs_autotune/manoeuvres/thrust_check.py",
        "gcs_autotune/manoeuvres/relay.py",
        "gcs_autotune/workflow/restore.py",
        "gcs_autotune/workflow/decision.py",
    ),
    "link": (
        "gcs_autotune/link/liveness.py",
        "gcs_autotune/link/parameters/client.py",
        "gcs_autotune/link/parameters/exchange.py",
        "gcs_autotune/link/transports/transport.py",
        "gcs_autotune/link/vehicle/actuation_check.py",
        "gcs_autotune/link/vehicle/handshake.py",
        "gcs_autotune/link/vehicle/interference_monitor.py",
        "gcs_autotune/link/vehicle/rc_monitor.py",
        "gcs_autotune/link/vehicle/setpoint_streamer.py",
        "gcs_autotune/link/vehicle/telemetry.py",
        "gcs_autotune/link/vehicle/vehicle_config.py",
        "gcs_autotune/mavlink/signing.py",
    ),
    "journal": (
        "gcs_autotune/link/parameters/journal.py",
        "gcs_autotune/link/parameters/parameter_transaction.py",
        "gcs_autotune/mavlink/params_file.py",
        "gcs_autotune/mavlink/tlog.py",
    ),
    "stamps": (
        "gcs_autotune/identify/axis/redating.py",
        "gcs_autotune/link/vehicle/latency.py",
        "gcs_autotune/link/vehicle/watchdog.py",
        "gcs_autotune/logs/dataflash.py",
        "gcs_autotune/logs/sample_store.py",
    ),
    "results": (
        "gcs_autotune/chi_square.py",
        "gcs_autotune/frames.py",
        "gcs_autotune/sname.py",
        "gcs_autotune/trial.py",
        "gcs_autotune/design/margins.py",
        "gcs_autotune/design/open_loop.py",
        "gcs_autotune/design/selection.py",
        "gcs_autotune/design/step_metrics.py",
        "gcs_autotune/design/verdict.py",
        "gcs_autotune/diagnose/heldout.py",
        "gcs_autotune/diagnose/score.py",
        "gcs_autotune/identify/axis/likelihood.py",
        "gcs_autotune/identify/axis/objective.py",
        "gcs_autotune/identify/axis/residuals.py",
        "gcs_autotune/identify/cleaning.py",
        "gcs_autotune/identify/colour.py",
        "gcs_autotune/identify/least_squares.py",
        "gcs_autotune/identify/unit_check.py",
        "gcs_autotune/logs/channels.py",
    ),
    "kernels": (
        "gcs_autotune/design/laws/kernel.py",
        "gcs_autotune/effects/kernels.py",
        "gcs_autotune/effects/narrow_band.py",
        "gcs_autotune/identify/kalman/sigma.py",
        "gcs_autotune/identify/kalman/sweep.py",
        "gcs_autotune/identify/kalman/transition.py",
        "gcs_autotune/models/coupled/kernel.py",
        "gcs_autotune/models/simulation.py",
    ),
}
"""Area -> files faults are put into."""

EQUIVALENT: dict[str, str] = {
    "gcs_autotune/mavlink/tlog.py::TlogReader.__init__: self.truncated = False -> pass": (
        "set at the end of every iteration; documented as complete only then"
    ),
}
"""Fault (``Mutant.key``) -> why nobody could notice it: it changes nothing that anybody may rely on. Judged by hand."""
