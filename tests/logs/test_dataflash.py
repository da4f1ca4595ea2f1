"""From blocks of messages to samples by boot: units and signs of every kind, stamps, boots, arming, counts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gcs_autotune.errors import BadFile
from gcs_autotune.logs import dataflash
from gcs_autotune.logs.dataflash import Missing, _boots, _Decoder, _events, _whole, record_dataflash, signals_of
from gcs_autotune.logs.sample_store import SampleStore

DEG = math.pi / 180.0


def columns(**values: Sequence[Any]) -> dict[str, NDArray[Any]]:
    return {
        name: np.array(v, dtype=object if any(isinstance(x, str) for x in v) else np.float64)
        for name, v in values.items()
    }


@pytest.mark.parametrize(
    ("kind", "told", "expected"),
    [
        ("ATT", {"Roll": 10.0, "Pitch": -20.0, "Yaw": 30.0}, {"attitude": {"phi": 10, "theta": -20, "psi": 30}}),
        ("AHR2", {"Roll": 10.0, "Pitch": -20.0, "Yaw": 30.0}, {"ahrs2": {"phi": 10, "theta": -20, "psi": 30}}),
        ("RATE", {"R": 1.0, "P": 2.0, "Y": -3.0}, {"rate": {"p": 1, "q": 2, "r": -3}}),
        ("STER", {"TurnRt": -4.0}, {"steering": {"r": -4}}),
    ],
)
def test_degrees_become_radians(kind: str, told: dict[str, float], expected: dict[str, dict[str, float]]) -> None:
    ((sensor, by),) = expected.items()
    found = signals_of(kind, columns(**{name: [v] for name, v in told.items()}))
    assert {n: v[0] for n, v in found.items()} == pytest.approx({f"{sensor}.{n}": v * DEG for n, v in by.items()})


EKF = {"PN": 1.0, "PE": -2.0, "PD": 3.0, "VN": 0.4, "VE": -0.5, "VD": 0.6}
TO_EKF = {"x": 1.0, "y": -2.0, "z": 3.0, "vn": 0.4, "ve": -0.5, "w": 0.6}


@pytest.mark.parametrize(
    ("kind", "told", "sensor", "expected"),
    [
        ("IMU", {"GyrX": 0.1, "GyrY": -0.2, "GyrZ": 0.3}, "imu", {"p": 0.1, "q": -0.2, "r": 0.3}),
        ("XKF1", EKF, "ekf", TO_EKF),
        ("NKF1", EKF, "ekf", TO_EKF),
        ("POS", {"Lat": 45.0, "Lng": -5.0, "RelHomeAlt": -3.0}, "global", {"lat": 45.0, "lon": -5.0, "z": 3.0}),
        ("CTUN", {"Alt": -3.0}, "control", {"z": 3.0}),
        ("BARO", {"Alt": -3.0}, "baro", {"z": 3.0}),
        ("RCOU", {"C1": 1500.0, "C14": 1600.0, "C15": 9.0}, "servo", {"1": 1500.0, "14": 1600.0}),
        ("RCIN", {"C1": 1500.0, "C3": 1600.0}, "rc", {"1": 1500.0, "3": 1600.0}),
    ],
)
def test_other_numbers_are_unchanged_and_altitudes_become_depths(
    kind: str, told: dict[str, float], sensor: str, expected: dict[str, float]
) -> None:
    found = signals_of(kind, columns(**{name: [v, v] for name, v in told.items()}))
    assert {n: v.tolist() for n, v in found.items()} == {f"{sensor}.{n}": [v, v] for n, v in expected.items()}


def test_a_gps_velocity_requires_a_3d_fix() -> None:
    found = signals_of(
        "GPS", columns(Lat=[45.0] * 3, Lng=[5.0] * 3, Status=[2, 3, 4], Spd=[2.0] * 3, GCrs=[120.0, 120.0, -30.0])
    )
    assert np.isnan([found[f"gps.{n}"][0] for n in ("U", "vn", "ve")]).all()
    assert found["gps.lat"].tolist() == [45.0] * 3 and found["gps.lon"].tolist() == [5.0] * 3
    assert found["gps.U"][1:].tolist() == [2.0, 2.0]
    assert found["gps.vn"][1:] == pytest.approx([-1.0, math.sqrt(3.0)])
    assert found["gps.ve"][1:] == pytest.approx([math.sqrt(3.0), -1.0])


@pytest.mark.parametrize("name", ["C", "I"])
def test_the_first_of_several_instances_is_read(name: str) -> None:
    found = signals_of("BARO", columns(Alt=[-1.0, -2.0, -3.0], **{name: [0, 1, 0]}))
    assert found["baro.z"][[0, 2]].tolist() == [1.0, 3.0]
    assert math.isnan(found["baro.z"][1])
    words = signals_of("BARO", columns(Alt=[-1.0, -2.0], **{name: ["a", "b"]}))
    assert words["baro.z"].tolist() == [1.0, 2.0]


def test_a_missing_or_text_column_is_reported() -> None:
    for reported in (columns(Roll=[1.0]), columns(Roll=["x"], Pitch=[1.0], Yaw=[1.0])):
        with pytest.raises(Missing):
            signals_of("ATT", reported)


@dataclass
class Block:
    """A block of messages of one kind; ``order`` are their numbers in the file."""

    kind: str
    order: Sequence[int]
    values: Mapping[str, Sequence[Any]]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.values)

    def column(self, name: str) -> NDArray[Any]:
        return columns(**{name: self.values[name]})[name]


def at(*seconds: float) -> list[float]:
    return [1e6 * t for t in seconds]


def depths(*pairs: tuple[int, float, float]) -> Block:
    """BARO messages: number in the file, time [s], depth [m]."""
    order, t, z = zip(*pairs, strict=True)
    return Block("BARO", order, {"TimeUS": at(*t), "Alt": [-v for v in z]})


def decoded(*pieces: list[Block]) -> tuple[_Decoder, list[SampleStore]]:
    decoder = _Decoder("log")
    for piece in pieces:
        decoder.write(piece)  # type: ignore[arg-type]
    return decoder, decoder.stores()


def test_samples_of_all_kinds_and_pieces_go_into_one_store_with_their_counts() -> None:
    decoder, (store,) = decoded(
        [
            Block("XXXX", [0], {"TimeUS": at(10.0), "A": [1.0]}),
            depths((1, 10.0, 1.0), (3, 10.2, 2.0)),
            Block("FMTU", [2, 4], {"Units": ["a", "b"]}),
            Block("CTUN", [5], {"TimeUS": at(10.25), "Alt": [-7.0]}),
        ],
        [depths((6, 10.4, 3.0)), Block("FMTU", [7], {"Units": ["c"]})],
    )
    assert (decoder.blocks, decoder.strays) == (6, 0)
    assert [column.tolist() for column in store.series("baro.z")] == [
        pytest.approx([10.0, 10.2, 10.4]),
        [1.0, 2.0, 3.0],
    ]
    assert store.series("control.z")[1].tolist() == [7.0]
    assert decoder.census.seen["BARO"] == [3, 10.0, pytest.approx(10.4)]
    assert decoder.census.seen["XXXX"] == [1, 10.0, 10.0]
    assert decoder.census.seen["FMTU"] == [3, 0.0, 10.25], "without a stamp: as old as what came before"
    assert (store.name, store.clock) == ("log", "vehicle (TimeUS)")


@pytest.mark.parametrize(("back", "boots"), [(4.9, 1), (5.1, 2)])
@pytest.mark.parametrize("together", [True, False])
def test_a_restarted_clock_begins_another_boot_of_the_same_vehicle(back: float, boots: int, together: bool) -> None:
    named = Block("VER", [0], {"TimeUS": at(100.0), "FWS": ["ArduSub V4.6.0"]})
    known = Block("PARM", [1], {"TimeUS": at(100.0), "Name": ["P"], "Value": [0.5]})
    first = [(k, 100.0 + 0.1 * k, 1.0) for k in range(2, 12)]
    again = [(k, 101.1 - back + 0.1 * (k - 12), 2.0) for k in range(12, 30)]
    pieces = (
        [[named, known, depths(*first, *again)]] if together else [[named, known, depths(*first)], [depths(*again)]]
    )
    decoder, stores = decoded(*pieces)
    assert len(stores) == boots
    assert decoder.strays == 0
    assert [len(store.series("baro.z")[0]) + store.late for store in stores] == ([28] if boots == 1 else [10, 18])
    last = stores[-1]
    assert (last.name, last.clock, last.vehicle) == ("log", "vehicle (TimeUS)", "ArduSub V4.6.0")
    assert last.firmware is not None and last.firmware.name == "ArduSub"
    assert last.parameters == {"P": 0.5}
    last.parameters["P"] = 9.0
    assert boots == 1 or stores[0].parameters == {"P": 0.5}


def test_a_piece_that_begins_exactly_five_seconds_back_belongs_to_the_same_boot() -> None:
    _, stores = decoded([depths((0, 100.0, 1.0), (1, 101.0, 1.0))], [depths((2, 96.0, 2.0), (3, 96.5, 2.0))])
    assert len(stores) == 1


def test_boots_are_separated_by_file_order_over_all_kinds() -> None:
    blocks = [
        depths((0, 50.0, 0.0), (4, 3.0, 0.0)),
        Block("CTUN", [2, 6], {"TimeUS": at(50.5, 3.5), "Alt": [0.0, 0.0]}),
    ]
    stamps = {"BARO": np.array([50.0, 3.0]), "CTUN": np.array([50.5, 3.5])}
    assert _boots(blocks, stamps) == [(-math.inf, 4.0), (4.0, math.inf)]  # type: ignore[arg-type]
    stamps["CTUN"][0] = np.nan
    assert _boots(blocks, stamps) == [(-math.inf, 4.0), (4.0, math.inf)]  # type: ignore[arg-type]
    stamps["BARO"][:] = (8.5, 3.5)
    assert _boots(blocks, stamps) == [(-math.inf, math.inf)], "exactly five seconds back is the same boot"  # type: ignore[arg-type]
    assert _boots(blocks, {}) == []  # type: ignore[arg-type]


def test_every_message_belongs_to_exactly_one_boot() -> None:
    _, stores = decoded(
        [depths(*((k, 50.0 + 0.1 * k, 1.0) for k in range(9)), *((k, 0.1 * k, 2.0) for k in range(9, 20)))]
    )
    assert [store.series("baro.z")[1].tolist() for store in stores] == [[1.0] * 9, [2.0] * 11]


def test_a_stray_stamp_is_left_out_and_counted() -> None:
    rows = [(k, 10.0 + 0.1 * k, float(k)) for k in range(30)]
    rows[12] = (12, 900.0, 12.0)
    decoder, (store,) = decoded([depths(*rows)], [depths(*((k, 10.0 + 0.1 * k, 0.0) for k in range(30, 50)))])
    assert decoder.strays == 1
    assert 12.0 not in store.series("baro.z")[1]
    assert len(store.series("baro.z")[1]) == 49
    assert decoder.census.seen["BARO"] == [49, 10.0, pytest.approx(14.9)]


def test_a_kind_with_zero_stamps_gets_the_time_of_the_preceding_message() -> None:
    rates = Block("RATE", [0, 3, 5], {"TimeUS": [0.0] * 3, "R": [0.0] * 3, "P": [0.0] * 3, "Y": [1.0, 2.0, 3.0]})
    depth = depths((1, 10.0, 1.0), (2, 10.1, 1.0), (4, 10.2, 1.0))
    decoder, (store,) = decoded([rates, depth])
    t, r = store.series("rate.r")
    assert t == pytest.approx([10.0, 10.1, 10.2])
    assert r == pytest.approx([DEG, 2.0 * DEG, 3.0 * DEG])
    assert (store.dated_by_arrival, decoder.unstamped, decoder.strays) == ({"rate"}, {"RATE"}, 0)
    _, (alone,) = decoded([Block("RATE", [0], {"TimeUS": [0.0], "R": [0.0], "P": [0.0], "Y": [1.0]})])
    assert alone.series("rate.r")[0].tolist() == [0.0], "with nothing else to go by it is left as it is"
    assert alone.dated_by_arrival == set()
    _, (both,) = decoded([depths((0, 0.0, 1.0), (1, 0.1, 1.0)), Block("CTUN", [2], {"TimeUS": at(0.2), "Alt": [0.0]})])
    assert both.dated_by_arrival == set(), "one that begins at nothing has stamps"


def test_kinds_without_numeric_stamps_are_ignored() -> None:
    decoder, (store,) = decoded(
        [
            Block("BARO", [0], {"Alt": [-1.0]}),
            Block("CTUN", [1], {"TimeUS": ["x"], "Alt": [-1.0]}),
            Block("ATT", [2], {"TimeUS": at(3.0), "Roll": [1.0]}),
            Block("IMU", [3], {"TimeUS": at(3.1), "GyrX": [0.1], "GyrY": [0.1], "GyrZ": [0.1]}),
        ]
    )
    assert "baro.z" not in store and "control.z" not in store and "attitude.phi" not in store
    assert store.series("imu.r")[1].tolist() == [0.1], "what lacks a column stops no other"
    assert decoder.census.seen["BARO"][0] == decoder.census.seen["ATT"][0] == 1


@pytest.mark.parametrize(
    ("arming", "parameters", "expected"),
    [
        ([], {}, [(1.0, True)]),
        ([], {"LOG_DISARMED": 0.0}, [(1.0, True)]),
        ([], {"LOG_DISARMED": 1.0}, []),
        ([(5.0, True)], {"LOG_DISARMED": 1.0}, [(1.0, False), (5.0, True)]),
        ([(8.0, True), (5.0, False)], {}, [(1.0, True), (5.0, False), (8.0, True)]),
        ([(8.0, False), (5.0, True)], {}, [(1.0, False), (5.0, True), (8.0, False)]),
    ],
)
def test_arming_before_the_first_event_is_its_opposite_and_without_events_armed(
    arming: list[tuple[float, bool]], parameters: dict[str, float], expected: list[tuple[float, bool]]
) -> None:
    decoder = _Decoder("log")
    decoder.write([depths((0, 1.0, 0.0), (1, 1.5, 0.0))])  # type: ignore[list-item]
    store = decoder._stores[0]
    store.arming, store.parameters, store.modes = list(arming), dict(parameters), [(3.0, 1), (2.0, 9)]
    assert decoder.stores()[0].arming == expected
    assert store.modes == [(2.0, 9), (3.0, 1)]


def test_every_boot_has_its_own_arming_state() -> None:
    _, stores = decoded(
        [depths(*((k, 50.0 + 0.1 * k, 1.0) for k in range(9)), *((k, 0.1 * k, 2.0) for k in range(9, 20)))]
    )
    assert [store.arming for store in stores] == [[(50.0, True)], [(pytest.approx(0.9), True)]]


def test_events_need_a_stamp_and_parameters_only_a_value() -> None:
    store, nan = SampleStore("log", "its"), math.nan
    _events(store, "PARM", np.array([nan, 1.0, 2.0]), columns(Name=["P", "I", "P"], Value=[0.5, nan, 0.7]))
    _events(store, "ARM", np.array([nan, 2.0]), columns(ArmState=[1.0, 0.0]))
    assert (store.parameters, store.arming) == ({"P": 0.7}, [(2.0, False)])
    for kind, reported in (("PARM", columns(Value=[1.0])), ("MSG", columns(Text=["x"]))):
        with pytest.raises(Missing):
            _events(store, kind, np.array([1.0]), reported)


def test_a_message_without_stamp_or_with_a_missing_number_is_left_out() -> None:
    nan = math.nan
    t, values = _whole(np.array([1.0, nan, 3.0, 4.0]), columns(a=[1.0, 2.0, nan, 4.0], b=[5.0, 6.0, 7.0, 8.0]))
    assert t.tolist() == [1.0, 4.0]
    assert {n: v.tolist() for n, v in values.items()} == {"a": [1.0, 4.0], "b": [5.0, 8.0]}


class Log:
    """A log of two pieces."""

    messages, damaged, damaged_bytes, truncated, preamble = 7, 0, 0, True, ()

    def __init__(self, stream: Any) -> None:
        stream.close()

    def __iter__(self):
        rows = [(k, 10.0 + 0.1 * k, float(k)) for k in range(30)]
        rows[12] = (12, 900.0, 12.0) if self.is_stray else rows[12]
        yield [depths(*rows)]
        yield [depths((30, 13.0, 30.0))]

    is_stray = False


@pytest.mark.parametrize(
    ("damaged", "is_stray", "words"),
    [
        (0, False, ""),
        (2, False, "2 segments of the log (9 bytes) were damaged and skipped"),
        (0, True, "1 timestamps were damaged and skipped"),
        (2, True, "2 segments of the log (9 bytes) and 1 timestamps were damaged and skipped"),
    ],
)
@pytest.mark.parametrize("binary", [True, False])
def test_a_log_is_read_in_pieces_and_its_damage_is_a_doubt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, damaged: int, is_stray: bool, words: str, binary: bool
) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(b"\xa3\x95\x80" if binary else b"\xef\xbb\xbf \r\n\tFMT, 128")
    log = type("Spoilt", (Log,), {"damaged": damaged, "damaged_bytes": 9, "is_stray": is_stray})
    monkeypatch.setattr(dataflash, "BinaryLog" if binary else "DataflashTextLog", log)
    found = record_dataflash(path)
    assert [n[:2] for n in found.notes] == ([("damaged-log", words)] if words else [])
    assert found.form == f"onboard log ({'binary' if binary else 'text'})"
    assert found.meta == {
        "source": "a.bin", "messages": 7, "damaged": damaged, "damaged_bytes": 9, "damaged_stamps": int(is_stray),
        "truncated": True,
    }  # fmt: skip
    (store,) = found.stores
    assert store.name == "a"
    assert store.series("baro.z")[1][-1] == 30.0
    assert found.census.seen["BARO"][0] == 31 - is_stray


def test_a_file_without_a_valid_start_or_messages_is_not_a_log(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(b"hello")
    with pytest.raises(BadFile, match="does not start with a binary message or an FMT line"):
        record_dataflash(path)
    path.write_bytes(b"FMT, 128")
    with pytest.raises(BadFile, match="contains no dataflash message"):
        record_dataflash(path)
