"""MAVLink without a link: frames, names, signing, telemetry logs and parameter files. It uses no sockets or serial
ports.

Only this module uses pymavlink. It is imported with the first name that needs it, so reading a CSV or a parameter file
does not import it.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gcs_autotune.mavlink.framing import (
        AT_WORK,
        Frame,
        Framer,
        Message,
        Packer,
        decode_frame,
        frame_length,
        mavlink,
        message_request,
        our_heartbeat,
        split_frames,
    )
    from gcs_autotune.mavlink.names import (
        StatusText,
        TextLog,
        VehicleIdentity,
        enum_name,
        firmware_version,
        message_fields,
        message_number,
        type_name,
        unique_id,
    )
    from gcs_autotune.mavlink.operator_control import (
        CONTROL_STATUS_NAMES,
        MANUAL_INPUT_NAMES,
        REQUEST_OPERATOR_CONTROL,
        ControlStatus,
        ManualInput,
        control_status,
        manual_input,
    )
    from gcs_autotune.mavlink.packed_parameters import PackedParameters, unpack_parameters
    from gcs_autotune.mavlink.params_file import load_params, save_params, save_qgc_params
    from gcs_autotune.mavlink.signing import LINK_ID, Refusal, Signer, SigningKey, StampStore, is_signed, refusals
    from gcs_autotune.mavlink.tlog import TlogReader, TlogRecord, TlogWriter, read_tlog

_HOMES = {
    "framing": "AT_WORK Frame Framer Message Packer decode_frame frame_length mavlink message_request our_heartbeat "
    "split_frames",
    "names": "StatusText TextLog VehicleIdentity enum_name firmware_version message_fields message_number type_name "
    "unique_id",
    "operator_control": "CONTROL_STATUS_NAMES MANUAL_INPUT_NAMES REQUEST_OPERATOR_CONTROL ControlStatus ManualInput "
    "control_status manual_input",
    "packed_parameters": "PackedParameters unpack_parameters",
    "params_file": "load_params save_params save_qgc_params",
    "signing": "LINK_ID Refusal Signer SigningKey StampStore is_signed refusals",
    "tlog": "TlogReader TlogRecord TlogWriter read_tlog",
}
_HOME = {name: home for home, names in _HOMES.items() for name in names.split()}

__all__ = [
    "AT_WORK",
    "CONTROL_STATUS_NAMES",
    "LINK_ID",
    "MANUAL_INPUT_NAMES",
    "REQUEST_OPERATOR_CONTROL",
    "ControlStatus",
    "Frame",
    "Framer",
    "ManualInput",
    "Message",
    "PackedParameters",
    "Packer",
    "Refusal",
    "Signer",
    "SigningKey",
    "StampStore",
    "StatusText",
    "TextLog",
    "TlogReader",
    "TlogRecord",
    "TlogWriter",
    "VehicleIdentity",
    "control_status",
    "decode_frame",
    "enum_name",
    "firmware_version",
    "frame_length",
    "is_signed",
    "load_params",
    "manual_input",
    "mavlink",
    "message_fields",
    "message_number",
    "message_request",
    "our_heartbeat",
    "read_tlog",
    "refusals",
    "save_params",
    "save_qgc_params",
    "split_frames",
    "type_name",
    "unique_id",
    "unpack_parameters",
]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
