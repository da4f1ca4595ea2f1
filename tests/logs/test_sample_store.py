"""Samples taken one by one and many at once: kept, counted, left out and read back."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
import pytest

from gcs_autotune.errors import ParameterMissing
from gcs_autotune.logs import Census
from gcs_autotune.logs.sample_store import RecordedParameters, SampleStore

Take = Callable[[SampleStore, list[float], Mapping[str, list[float]]], None]


def one_by_one(store: SampleStore, t: list[float], values: Mapping[str, list[float]]) -> None:
    for i, stamp in enumerate(t):
        store.take(stamp, {name: column[i] for name, column in values.items()})


def at_once(store: SampleStore, t: list[float], values: Mapping[str, list[float]]) -> None:
    store.take_all(np.array(t), {name: np.array(column) for name, column in values.items()})


@pytest.fixture(params=[one_by_one, at_once])
def take(request: pytest.FixtureRequest) -> Take:
    found: Take = request.param
    return found


@pytest.fixture
def store() -> SampleStore:
    return SampleStore("log", "the vehicle's")


def test_samples_older_than_the_newest_of_their_kind_are_counted_and_left_out(store: SampleStore, take: Take) -> None:
    take(store, [1.0, 3.0, 2.0, 3.0, 4.0], {"local.x": [1.0, 2.0, 9.0, 3.0, 4.0], "local.y": [0.0, 0.0, 9.0, 0.0, 0.0]})
    assert store.late == 1
    take(store, [3.9, 3.5, 4.0, 5.0], {"local.x": [9.0, 9.0, 5.0, 6.0], "local.y": [9.0, 9.0, 0.0, 0.0]})
    assert (store.late, store.absurd) == (3, 0)
    t, x = store.series("local.x")
    assert t.tolist() == [1.0, 3.0, 3.0, 4.0, 4.0, 5.0]
    assert x.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    assert store.series("local.y")[1].tolist() == [0.0] * 6
    take(store, [0.5], {"local.z": [7.0]})  # another kind has a newest of its own
    assert store.series("local.z")[0].tolist() == [0.5] and store.late == 3


@pytest.mark.parametrize(
    ("source", "most"),
    [("att.phi", 10.0), ("att.r", 200.0), ("gps.U", 200.0), ("ekf.z", 1e7), ("gps.lat", 90.0), ("servo.1", 1e5)],
)
def test_impossible_values_are_counted_with_their_whole_message(
    source: str, most: float, store: SampleStore, take: Take
) -> None:
    bad = [math.nan, math.inf, -math.inf, 1.001 * most, -1.001 * most]
    take(store, [0.0] * 5, {source: bad, "att.psi": [1.0] * 5})
    assert store.absurd == 5 and source not in store
    take(store, [1.0, 2.0, 3.0], {source: [most, math.nan, -most], "att.psi": [1.0, 1.0, 2.0]})
    take(store, [4.0], {source: [0.0], "att.psi": [math.nan]})
    assert (store.absurd, store.late) == (7, 0)
    assert store.series(source)[1].tolist() == [most, -most]
    assert store.series("att.psi")[1].tolist() == [1.0, 2.0]


def test_samples_without_stamps_or_values_are_left_out(store: SampleStore) -> None:
    at_once(store, [], {"local.x": []})
    store.take(1.0, {})
    at_once(store, [math.nan, 1.0, math.inf], {"local.x": [1.0, 2.0, 3.0]})
    assert store.absurd == 2
    at_once(store, [0.5], {"local.x": [4.0]})
    assert store.late == 1
    assert store.series("local.x")[1].tolist() == [2.0]


def test_a_constant_column_that_changes_is_read_back_completely(store: SampleStore, take: Take) -> None:
    first, later = [5.0, 5.0, 5.0], [5.0, 6.0, 5.0]
    take(store, [0.0, 1.0, 2.0], {"servo.1": first})
    assert store.series("servo.1")[1].tolist() == first
    take(store, [3.0, 4.0, 5.0], {"servo.1": later})
    take(store, [6.0, 7.0], {"servo.1": [5.0, 5.0]})
    t, values = store.series("servo.1")
    assert values.tolist() == first + later + [5.0, 5.0]
    assert t.tolist() == list(range(8))


def test_a_source_of_two_messages_is_read_in_order_of_time(store: SampleStore) -> None:
    one_by_one(store, [1.0, 3.0], {"ekf.z": [1.0, 3.0]})
    one_by_one(store, [0.0, 2.0, 3.0], {"ekf.z": [0.0, 2.0, 4.0], "ekf.x": [0.0, 0.0, 0.0]})
    t, z = store.series("ekf.z")
    assert (t.tolist(), z.tolist()) == ([0.0, 1.0, 2.0, 3.0, 3.0], [0.0, 1.0, 2.0, 3.0, 4.0])
    assert [len(part) for part in store.series("ekf.y")] == [0, 0]
    assert "ekf.x" in store and "ekf.y" not in store


def test_channel_numbers_span_and_gaps_cover_all_messages(store: SampleStore) -> None:
    assert (store.span, store.silences(1.0), store.numbered("servo")) == ((0.0, 0.0), [], [])
    one_by_one(store, [2.0, 2.5, 6.0], {"servo.10": [1.0] * 3, "servo.2": [1.0] * 3, "servox": [1.0] * 3})
    one_by_one(store, [1.0, 4.0, 7.0, 9.1], {"servo.3": [1.0] * 4})
    assert store.numbered("servo") == [2, 3, 10]
    assert store.span == (1.0, 9.1)
    assert store.silences(2.0) == [(7.0, 9.1)]
    assert store.silences(1.9) == [(4.0, 6.0), (7.0, 9.1)]


def test_a_census_counts_kinds_and_their_rates() -> None:
    census = Census()
    for t in (3.0, 1.0, 2.0, math.nan, math.inf, -math.inf):
        census.count("ATTITUDE", t)
    census.count("GPS", 10.0, 21, until=20.0)
    census.count("ONCE", 5.0)
    assert census.seen["ATTITUDE"] == [6, 1.0, 3.0]
    assert (census.rate("ATTITUDE"), census.rate("GPS")) == (2.5, 2.0)
    assert (census.rate("ONCE"), census.rate("NEVER")) == (0.0, 0.0)


def test_parameters_of_a_log_are_those_it_contains() -> None:
    reported = RecordedParameters({"P": 0.2, "I": 0.1})
    assert (reported.read("P"), reported.read_all(["I", "P"])) == (0.2, {"I": 0.1, "P": 0.2})
    assert reported.read_existing(["P", "D"]) == {"P": 0.2}
    with pytest.raises(ParameterMissing, match="D, FF") as caught:
        reported.read_all(["P", "D", "FF"])
    assert caught.value.name == "D"


def test_columns_of_one_message_share_their_stamps() -> None:
    store = SampleStore("a log", "its own")
    for t in (1.0, 2.0):
        store.take(t, {"a.psi": 0.1 * t, "a.r": 0.2})
    (group,) = store._groups.values()
    times = group.times()
    assert times.tolist() == [1.0, 2.0]
    assert group.times() is times, "they cost memory only once"
    assert store.series("a.psi")[0] is store.series("a.r")[0]
    assert group.columns[1].values is None, "nor does a value that stands cost more than one"
    store.take(3.0, {"a.psi": 0.3, "a.r": 0.2})
    assert group.times().tolist() == [1.0, 2.0, 3.0]
