"""The parameters of the axis being tuned: read under the vehicle's own names at the start, and again at the end."""

from __future__ import annotations

from gcs_autotune.errors import AutotuneError, ParameterMissing
from gcs_autotune.firmware import Axis, read_named
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.workflow.record import RunDirectory
from gcs_autotune.workflow.tale import Tale

__all__ = ["learn_parameters", "read_again"]


def learn_parameters(craft: MavlinkCraft, axis: Axis, tale: Tale) -> tuple[Axis, dict[str, float]]:
    """Return *axis* under the vehicle's own names, and the values found, keyed by those.

    Raises
    ------
    ParameterMissing
        The vehicle has one of the gains under no name we know.
    """
    wanted = [*(gain.parameter for gain in axis.gains), *axis.context]
    names, found = read_named(craft.parameters, wanted)
    missing = [name for name in wanted if names.own(name) not in found]
    gains = [gain.parameter for gain in axis.gains if gain.parameter in missing]
    if gains:
        raise ParameterMissing(
            f"{craft.session.vehicle} has no parameter {', '.join(gains)}, nor under any newer name we know; "
            "its firmware is older, newer or built without that feature",
            name=gains[0],
        )
    if missing:
        tale.say(f"this firmware has no {', '.join(missing)}; the design does without")
    return axis.called(names), found


def read_again(craft: MavlinkCraft, tale: Tale, record: RunDirectory) -> None:
    """Read the parameters once more, whatever happened: the proof of what the vehicle holds now."""
    try:
        with craft.shielded():
            after = craft.parameters.read_existing(tale.parameters_before, as_is=True)
    except AutotuneError as error:
        tale.say(f"the parameters could not be read again: {error}")
    else:
        tale.parameters_after = after
        record.save_parameters("after", after)
