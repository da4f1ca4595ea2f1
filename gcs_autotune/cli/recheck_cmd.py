"""``gcs-autotune recheck``: how well is a loop tuned that has been flown for a while? Nothing is written."""

from __future__ import annotations

import argparse

from gcs_autotune.cli.command import Command, add_connection, add_output
from gcs_autotune.cli.fly_cmd import COMMAND as FLY
from gcs_autotune.cli.fly_cmd import DEFAULT_CONNECTION, add_flight, run_flight

__all__ = ["COMMAND"]

RELAY = ("set-point", "hysteresis", "second-set-point", "second-hysteresis")


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("axis", choices=("heading",), help="the loop")
    add_connection(parser, otherwise=DEFAULT_CONNECTION)
    add_output(parser)
    add_flight(parser, RELAY)


def _run(args: argparse.Namespace) -> int:
    flight = argparse.ArgumentParser()
    FLY.add_arguments(flight)
    given = argparse.Namespace(**vars(args))  # what is not asked here is as `fly` has it where nothing is said
    return run_flight(flight.parse_args(["set-point-relay"], given))


COMMAND = Command(
    name="recheck",
    help="tell natural frequency and damping of the heading loop as it is, without driving an actuator",
    description="Fly two relays on the autopilot's own heading set-point (fly set-point-relay) and read the closed "
    "loop off them: natural frequency, damping, overshoot. No parameter is written. Without --connect a simulated boat "
    "is used.",
    add_arguments=_add_arguments,
    run=_run,
)
