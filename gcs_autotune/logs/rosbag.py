"""Convert ROS bags (ROS 1 ``.bag``, ROS 2 ``.db3``, ``.mcap`` or their directory) to runs, read by rosbags (extra
``formats``).

ROS uses east, north, up and ahead, port, up (REP 103). This program uses north, east, down and ahead, starboard, down.
Frames whose name ends in ``_ned`` or ``_frd`` need no conversion. Numbers of other topics keep the topic's name, for
``--columns``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from gcs_autotune.csv_table import LAST, is_believable
from gcs_autotune.errors import BadFile
from gcs_autotune.logs.format import Format, Head, absent
from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Channel, Note, Trial
from gcs_autotune.untrusted_text import visible

__all__ = ["FORMAT", "read_bag"]

Message: TypeAlias = Any
Samples: TypeAlias = dict[str, float]

INSTEAD = "convert it to CSV (ros2 bag, bagpy: bag.message_by_topic) and map the columns with --columns"
OURS = ("_ned", "_frd")
CAPACITY = 20_000_000
"""Most messages read from one bag. Project choice."""


def _signs(frame: str) -> float:
    """Return -1 if a frame is positive to port and up, 1 if it is positive to starboard and down."""
    return 1.0 if frame.lower().endswith(OURS) else -1.0


def _angles(q: Message, frame: str) -> Samples:
    w, x, y, z = q.w, q.x, q.y, q.z
    if not 0.9 < w * w + x * x + y * y + z * z < 1.1:
        return {}
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x))))
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    is_ours = frame.lower().endswith(OURS)
    return {"phi": roll, "theta": pitch if is_ours else -pitch, "psi": yaw if is_ours else 0.5 * math.pi - yaw}


def _position(p: Message, frame: str) -> Samples:
    return {"x": p.x, "y": p.y, "z": p.z} if frame.lower().endswith(OURS) else {"x": p.y, "y": p.x, "z": -p.z}


def _vector(v: Message, names: str, frame: str) -> Samples:
    sign = _signs(frame)
    return {names[0]: v.x, names[1]: sign * v.y, names[2]: sign * v.z}


def _odometry(m: Message) -> Samples:
    world, body = m.header.frame_id, m.child_frame_id
    pose, twist = m.pose.pose, m.twist.twist
    moving = {**_vector(twist.linear, "uvw", body), **_vector(twist.angular, "pqr", body)}
    return {**_position(pose.position, world), **_angles(pose.orientation, world), **moving}


def _imu(m: Message) -> Samples:
    frame = m.header.frame_id
    return {**_angles(m.orientation, frame), **_vector(m.angular_velocity, "pqr", frame)}


def _wrench(m: Message) -> Samples:
    frame, w = (m.header.frame_id, m.wrench) if hasattr(m, "wrench") else ("", m)
    return {**_vector(w.force, "XYZ", frame), **_vector(w.torque, "KMN", frame)}


def _pose(m: Message) -> Samples:
    frame, pose = m.header.frame_id, m.pose.pose if hasattr(m.pose, "pose") else m.pose
    return {**_position(pose.position, frame), **_angles(pose.orientation, frame)}


KINDS: Mapping[str, Callable[[Message], Samples]] = {
    "nav_msgs/msg/Odometry": _odometry,
    "geometry_msgs/msg/PoseStamped": _pose,
    "geometry_msgs/msg/PoseWithCovarianceStamped": _pose,
    "sensor_msgs/msg/Imu": _imu,
    "geometry_msgs/msg/WrenchStamped": _wrench,
    "geometry_msgs/msg/Wrench": _wrench,
    "mavros_msgs/msg/RCOut": lambda m: {f"servo{i}": float(v) for i, v in enumerate(m.channels, start=1)},
}
"""Type of message -> channels.

If two topics have the same channel, the type listed first is used, then the first topic.
"""
_PLAIN = ("Float64", "Float32", "Int64", "Int32", "Int16", "UInt16")
NUMBERS = frozenset(f"std_msgs/msg/{kind}" for kind in _PLAIN)
ARRAYS = frozenset(f"std_msgs/msg/{kind}MultiArray" for kind in _PLAIN)


def read_bag(path: Path, columns: Mapping[str, str]) -> list[Trial]:
    """Read the run in the bag at *path*; *columns* are applied to its channels afterwards.

    Raises
    ------
    BadFile
        The bag is unreadable or contains no supported topic, or rosbags is not installed.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise absent(path, "a ROS bag", "rosbags", INSTEAD) from None
    from gcs_autotune.logs.renaming import renamed

    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            found, topics = _collected(reader)
    except Exception as error:  # noqa: BLE001 - what reads a damaged file may raise anything
        why = visible(str(error).partition("\n")[0][:80]) or type(error).__name__
        raise BadFile(f"{path} is a ROS bag that cannot be read ({why}): {INSTEAD}") from None
    if not found:
        shown = ", ".join(visible(f"{name} ({kind})") for name, kind in topics[:8]) or "none"
        raise BadFile(f"{path} is a ROS bag without a supported topic (its topics: {shown}): {INSTEAD}")
    channels: dict[str, Channel] = {}
    notes: list[Note] = []
    for name, (t, values) in found.items():
        unit = "pwm" if name.startswith("servo") else SIGNALS.get(name, ("1", ""))[0]
        order = np.argsort(t, kind="stable")
        stamps, numbers = np.array(t)[order], np.array(values, dtype=np.float64)[order]
        keep, doubts = is_believable(name, numbers, path.name)
        keep &= np.abs(stamps) <= LAST
        notes += doubts
        channels[name] = Channel(name, unit, stamps[keep], numbers[keep])
    notes += [
        (
            "ros-axes",
            f"the axes of {path.name} were converted from the ROS convention (east, north, up; ahead, port, up)",
            "use frame names such as map_ned and base_link_frd if the axes are north, east, down",
        )
    ]
    run = Trial(visible(path.stem), channels, meta={"source": path.name, "format": "ROS bag", "notes": notes})
    return [renamed(run, columns) if columns else run]


def _collected(reader: Any) -> tuple[dict[str, tuple[list[float], list[float]]], list[tuple[str, str]]]:
    """Return channel -> stamps [s] and values, and (name, kind) of every topic in the bag."""
    topics = [(c.topic, c.msgtype) for c in reader.connections]
    order = [*KINDS, *sorted(NUMBERS), *sorted(ARRAYS)]
    known = [c for c in reader.connections if c.msgtype in order]
    known.sort(key=lambda c: order.index(c.msgtype))
    if not known:
        return {}, topics
    rank = {c.id: i for i, c in enumerate(known)}
    owner: dict[str, int] = {}
    found: dict[str, tuple[list[float], list[float]]] = {}
    for count, (connection, stamp, raw) in enumerate(reader.messages(connections=known)):
        if count >= CAPACITY:
            break
        message = reader.deserialize(raw, connection.msgtype)
        header = getattr(message, "header", None)
        t = header.stamp.sec + 1e-9 * header.stamp.nanosec if header is not None and header.stamp.sec else 1e-9 * stamp
        for name, value in _samples(connection, message):
            mine = rank[connection.id]
            if owner.setdefault(name, mine) > mine:
                owner[name], found[name] = mine, ([], [])
            if owner[name] == mine and math.isfinite(value):
                stamps, values = found.setdefault(name, ([], []))
                stamps.append(t)
                values.append(float(value))
    return found, topics


def _samples(connection: Any, message: Message) -> Iterator[tuple[str, float]]:
    if connection.msgtype in KINDS:
        yield from KINDS[connection.msgtype](message).items()
        return
    name = visible(connection.topic.strip("/").replace("/", "_"))
    if connection.msgtype in NUMBERS:
        yield name, float(message.data)
    else:
        yield from ((f"{name}_{i}", float(value)) for i, value in enumerate(message.data, start=1))


def _fits(head: Head) -> bool:
    if head.path.is_dir():
        try:
            return "rosbag2_bagfile_information" in (head.path / "metadata.yaml").read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError):
            return False
    return head.data.startswith((b"#ROSBAG V", b"\x89MCAP0\r\n")) or (
        head.data.startswith(b"SQLite format 3") and b"topics" in head.data
    )


FORMAT = Format("a ROS bag", _fits, (".bag", ".mcap", ".db3"), runs=read_bag)
