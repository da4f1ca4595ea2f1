"""``gcs-autotune recheck``: test whether the gains of an earlier tune are still good. Nothing is written."""

from __future__ import annotations

import argparse

from gcs_autotune.axes import axis_kind
from gcs_autotune.cli.command import Command, add_connection, add_output, check_axis_limits
from gcs_autotune.cli.fly_cmd import COMMAND as FLY
from gcs_autotune.cli.fly_cmd import DEFAULT_CONNECTION, add_flight, run_flight

__all__ = ["COMMAND"]

LOOPS = ("heading", "depth", "speed")
RELAY = ("set-point", "hysteresis", "second-set-point", "second-hysteresis")


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("axis", choices=LOOPS, help="loop to check")
    add_connection(parser, otherwise=DEFAULT_CONNECTION)
    add_output(parser)
    add_flight(parser, RELAY)


def _run(args: argparse.Namespace) -> int:
    flight = argparse.ArgumentParser()
    FLY.add_arguments(flight)
    check_axis_limits(args, RELAY)
    given = argparse.Namespace(**vars(args))  # other options have the defaults of `fly`
    axis = axis_kind(args.axis)
    given.force = axis.names.force
    return run_flight(flight.parse_args(["set-point-relay"], given), axis.example, recheck=axis)


COMMAND = Command(
    description="Fly two relay experiments on the autopilot's set-point of heading, depth (ROVs) or speed (boats), "
    "like fly set-point-relay, and then the step of the last tune of the same vehicle in the folder of runs. The two "
    "steps are compared. The verdict is good, degraded since the tune, poorly damped, oscillates, undecided, or not "
    "identifiable. Without an earlier tune a step is flown only if the relays give no clear verdict. No parameter is "
    "written. "
    "Without --connect a simulated vehicle is used.",
    add_arguments=_add_arguments,
    run=_run,
    everyday=("connect", "set-point", "throttle", "max-distance", "max-time", "area", "yes", "out", "verbose", "json"),
    examples=(("gcs-autotune recheck heading --connect /dev/ttyUSB0", "is the heading loop still well tuned?"),),
)
