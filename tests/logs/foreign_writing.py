"""Writes the logs of other tools for these tests: a ULog, a MAT file, a ROS 2 bag, all of one zigzagging craft."""

from __future__ import annotations

import io
import math
import struct
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import scipy.io

STEP, COUNT = 0.05, 400
T = STEP * np.arange(COUNT)
N = np.where(np.arange(COUNT) // 60 % 2, 0.4, -0.4)


def turned() -> tuple[np.ndarray, np.ndarray]:
    """Heading and turn rate of a first-order craft driven by N: 1.2 s, half a rad/s at full."""
    psi, r = np.zeros(COUNT), np.zeros(COUNT)
    for k in range(COUNT - 1):
        r[k + 1] = r[k] + STEP * (0.5 * N[k] - r[k]) / 1.2
        psi[k + 1] = psi[k] + STEP * r[k]
    return psi, r


PSI, R = turned()


class ULogWriter:
    """Writes PX4's log format: definitions, subscriptions, data."""

    CODES: Mapping[str, str] = {"uint64_t": "Q", "float": "f", "uint8_t": "B", "int32_t": "i"}

    def __init__(self) -> None:
        self.pieces = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)]
        self.topics: list[str] = []

    def message(self, kind: str, body: bytes) -> None:
        self.pieces.append(struct.pack("<HB", len(body), ord(kind)) + body)

    def format(self, topic: str, *fields: str) -> None:
        self.message("F", f"{topic}:{''.join(f + ';' for f in ('uint64_t timestamp', *fields))}".encode())

    def parameter(self, name: str, value: float) -> None:
        key = f"float {name}".encode()
        self.message("P", bytes([len(key)]) + key + struct.pack("<f", value))

    def subscribe(self, topic: str) -> None:
        self.message("A", struct.pack("<BH", 0, len(self.topics)) + topic.encode())
        self.topics.append(topic)

    def data(self, topic: str, t: float, layout: str, *values: float) -> None:
        number = self.topics.index(topic)
        self.message("D", struct.pack(f"<HQ{layout}", number, round(t * 1e6), *values))


def ulog() -> bytes:
    log = ULogWriter()
    log.format("vehicle_attitude", "float[4] q")
    log.format("vehicle_angular_velocity", "float[3] xyz")
    log.format("vehicle_torque_setpoint", "float[3] xyz")
    log.format("vehicle_thrust_setpoint", "float[3] xyz")
    log.format("vehicle_status", "uint8_t arming_state", "uint8_t nav_state")
    log.parameter("GND_SPEED_P", 0.25)
    for topic in ("vehicle_attitude", "vehicle_angular_velocity", "vehicle_torque_setpoint", "vehicle_thrust_setpoint",
                  "vehicle_status"):  # fmt: skip
        log.subscribe(topic)
    log.data("vehicle_status", 9.0, "BB", 1, 0)
    for t, n, psi, r in zip(10.0 + T, N, PSI, R, strict=True):
        if t == 10.0:
            log.data("vehicle_status", t, "BB", 2, 0)
        log.data("vehicle_torque_setpoint", t, "fff", 0.0, 0.0, n)
        log.data("vehicle_thrust_setpoint", t, "fff", 0.5, 0.0, 0.0)
        log.data("vehicle_attitude", t, "ffff", math.cos(psi / 2), 0.0, 0.0, math.sin(psi / 2))
        log.data("vehicle_angular_velocity", t, "fff", 0.0, 0.0, r)
    return b"".join(log.pieces)


def mat(**columns: np.ndarray) -> bytes:
    stream = io.BytesIO()
    scipy.io.savemat(stream, columns or {"t": T, "psi": PSI, "r": R, "N": N})
    return stream.getvalue()


def bag2(folder: Path) -> Path:
    """A ROS 2 bag as a ship's stack writes it: odometry, wrench and pulses, east, north, up."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds = store.types
    header, stamp = kinds["std_msgs/msg/Header"], kinds["builtin_interfaces/msg/Time"]
    vector, point, turn = (kinds[f"geometry_msgs/msg/{k}"] for k in ("Vector3", "Point", "Quaternion"))
    pose, twist, wrench = (kinds[f"geometry_msgs/msg/{k}"] for k in ("Pose", "Twist", "Wrench"))
    with_pose, with_twist = (kinds[f"geometry_msgs/msg/{k}WithCovariance"] for k in ("Pose", "Twist"))
    odometry, wrenched = kinds["nav_msgs/msg/Odometry"], kinds["geometry_msgs/msg/WrenchStamped"]
    path, spread = folder / "bag", np.zeros(36)
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        where = writer.add_connection("/odom", odometry.__msgtype__, typestore=store)
        what = writer.add_connection("/thrust", wrenched.__msgtype__, typestore=store)
        pulses = kinds["std_msgs/msg/UInt16MultiArray"]
        driven = writer.add_connection("/motors", pulses.__msgtype__, typestore=store)
        plain = kinds["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
        for k, t in enumerate(T):
            ns = round((1714644000.0 + t) * 1e9)
            head = header(stamp=stamp(sec=ns // 10**9, nanosec=ns % 10**9), frame_id="map")
            yaw = 0.5 * math.pi - PSI[k]
            at = pose(point(x=3.0, y=2.0, z=1.0), turn(x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2)))
            going = twist(vector(x=1.5, y=0.2, z=0.0), vector(x=0.0, y=0.0, z=-R[k]))
            message = odometry(head, "base_link", with_pose(at, spread), with_twist(going, spread))
            writer.write(where, ns, store.serialize_cdr(message, odometry.__msgtype__))
            force = wrench(vector(x=20.0, y=0.0, z=0.0), vector(x=0.0, y=0.0, z=-float(N[k])))
            writer.write(what, ns, store.serialize_cdr(wrenched(head, force), wrenched.__msgtype__))
            widths = np.array([1500 + round(100 * float(N[k])), 1500], dtype=np.uint16)
            writer.write(driven, ns, store.serialize_cdr(pulses(plain, widths), pulses.__msgtype__))
    return path
