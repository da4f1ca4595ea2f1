"""Parameter requests and answers: what is outstanding, requested again, and accepted as an answer."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from gcs_autotune.clock import ManualClock
from gcs_autotune.errors import NoReply, ParameterMissing, ParameterNotAccepted, TelemetryFault
from gcs_autotune.link import Parameters, same_float32
from gcs_autotune.link.parameters.client import _decided, _winner, read_confirmed
from gcs_autotune.link.parameters.exchange import ParamExchange, ParamWatch, as_float32, read_list


class Answering:
    """A session with a vehicle that holds ``held``; ``answer`` handles a request."""

    def __init__(self, **held: float) -> None:
        self.held = held
        self.vehicle: Any = SimpleNamespace(system=7, component=2)
        self.clock = self.liveness = ManualClock(100.0)
        self.notes: list[str] = []
        self.lossy = str  # it loses nothing
        self.texts = SimpleNamespace(recent=self.recent)
        self.looked_back: list[float] = []
        self.listeners: dict[str, list[Any]] = {}
        self.sent: list[Any] = []
        self.waits: list[tuple[int, float]] = []
        self.queue: deque[tuple[str, Any]] = deque()
        self.answer: Callable[[Any], None] = self.honest

    def recent(self, since: float, at_most: int) -> list[str]:
        self.looked_back.append(self.clock.now() - since)
        return ["Q is wrong", "P is read-only", "P: still is"][:at_most]

    def listen(self, name: str, listener: Any) -> Any:
        self.listeners.setdefault(name, []).append(listener)
        return lambda: self.listeners[name].remove(listener)

    def send(self, message: Any) -> None:
        assert (message.target_system, message.target_component) == (7, 2)
        self.sent.append(message)
        self.answer(message)

    def honest(self, message: Any) -> None:
        kind, names = message.get_type(), list(self.held)
        if kind == "PARAM_REQUEST_LIST":
            for k in range(len(names)):
                self.value(names[k], index=k)
        elif kind == "PARAM_SET":
            self.held[message.param_id] = message.param_value
            self.value(message.param_id)
        elif message.param_index >= 0:
            self.value(names[message.param_index], index=message.param_index)
        elif message.param_id in self.held:
            self.value(message.param_id)

    def value(self, name: str, value: float | None = None, index: int = 65535) -> None:
        reported = self.held[name] if value is None else value
        self.queue.append(("PARAM_VALUE", SimpleNamespace(
            param_id=name, param_value=reported, param_type=9, param_index=index, param_count=len(self.held),
        )))  # fmt: skip

    def wait_for(self, condition: Callable[[], Any], timeout: float) -> Any:
        self.waits.append((len(self.sent), timeout))
        found = condition()
        while self.queue:
            name, message = self.queue.popleft()
            for listener in list(self.listeners.get(name, [])):
                listener(message)
        found = condition() if found is None else found
        if found is None:
            self.clock.advance(timeout)
        return found

    def asked(self) -> Counter[str]:
        return Counter(m.param_id for m in self.sent if m.get_type() == "PARAM_REQUEST_READ")


def parameters(session: Answering) -> Parameters:
    return Parameters(session)  # type: ignore[arg-type]


def exchange(session: Answering) -> ParamExchange:
    return ParamExchange(session)  # type: ignore[arg-type]


def test_ten_requests_are_outstanding_at_once_and_each_ten_get_a_second() -> None:
    session = Answering(**{f"P{k}": float(k) for k in range(23)})
    assert parameters(session).read_all(session.held) == session.held
    assert session.waits == [(10, 1.0), (20, 1.0), (23, 1.0)]
    assert session.clock.now() == 100.0, "what is answered is not waited for"


def test_alternative_names_are_requested_in_five_groups_and_answered_ones_not_again() -> None:
    session = Answering(**{f"OLD{k}": float(k) for k in range(7)})
    session.held["NEW1"] = 9.0
    groups = [(f"NEW{k}", f"OLD{k}") for k in range(7)] + [("NONE", "NEITHER")]
    assert parameters(session).read_any(groups) == {"OLD0": 0.0, "NEW1": 9.0, **{f"OLD{k}": k for k in range(2, 7)}}
    assert session.waits[:2] == [(10, 1.0), (16, 1.0)]
    assert (session.asked()["NONE"], session.asked()["OLD3"], session.asked()["NEW3"]) == (3, 1, 1)


@pytest.mark.parametrize(("lost", "asked"), [(0, 3), (1, 6), (2, 6)])
def test_an_unanswered_name_is_requested_three_times_or_six_on_a_lossy_link(lost: int, asked: int) -> None:
    session = Answering(P=0.5)
    dropped = [0]

    def lossy(message: Any) -> None:
        if message.param_id == "P" and dropped[0] < lost:
            dropped[0] += 1
        else:
            session.honest(message)

    session.answer = lossy
    assert parameters(session).read_existing(["P", "NONE", "P"]) == {"P": 0.5}
    assert (session.asked()["NONE"], session.asked()["P"]) == (asked, lost + 1)


def test_all_missing_names_are_reported_and_a_silent_vehicle_is_distinguished() -> None:
    session = Answering(P=0.5)
    mine = parameters(session)
    with pytest.raises(ParameterMissing, match="has no parameter A, B") as caught:
        mine.read_all(["A", "P", "B"])
    assert caught.value.name == "A"
    session.answer = lambda message: None
    with pytest.raises(NoReply, match=r"no longer answers parameter requests \(A\)"):
        mine.read("A")


def test_a_long_list_of_missing_names_is_shortened() -> None:
    with pytest.raises(ParameterMissing, match=r"P0, .*P7 and 82 others\. Check that this is the right vehicle"):
        parameters(Answering(P=0.5)).read_all(["P", *(f"P{i}" for i in range(90))])


def test_the_first_answered_of_several_names_is_used_within_three_requests() -> None:
    session = Answering(OLD=0.5, OLDER=0.7)
    assert parameters(session).read_first(["NEW", "OLD", "OLDER"]) == ("OLD", 0.5)
    assert session.asked()["NEW"] == 1
    nobody = Answering()
    with pytest.raises(ParameterMissing, match="has none of NEW, OLD") as caught:
        parameters(nobody).read_first(["NEW", "OLD"])
    assert (caught.value.name, nobody.asked()["OLD"]) == ("NEW", 3)


@pytest.mark.parametrize(
    ("votes", "winner"),
    [({}, None), ({1.0: 1}, None), ({1.0: 2}, 1.0), ({1.0: 2, 2.0: 2}, None), ({1.0: 2, 2.0: 3, 3.0: 1}, 2.0)],
)
def test_a_value_wins_when_received_twice_and_more_often_than_any_other(
    votes: dict[float, int], winner: float | None
) -> None:
    assert _winner(votes) == winner
    if winner is None:
        with pytest.raises(TelemetryFault, match="contradicting values of P"):
            _decided("P", votes)
    else:
        assert _decided("P", votes) == winner


def test_contradicting_answers_are_given_up_after_eight_requests() -> None:
    session = Answering(P=0.5)

    def both(message: Any) -> None:
        session.value("P", 0.1)
        session.value("P", 0.0)

    session.answer = both
    with pytest.raises(TelemetryFault, match=r"\(0, 0\.1\)"):
        read_confirmed(parameters(session), ["P"])
    assert session.asked()["P"] == 9, "twice at once to begin with, for a second answer in the same time"
    assert len(session.listeners["PARAM_VALUE"]) == 2, "no counter is left"
    steady = Answering(P=0.5, I=0.2)
    assert read_confirmed(parameters(steady), ["P", "I", "P"]) == {"P": 0.5, "I": 0.2}
    assert steady.asked() == {"P": 2, "I": 2}


def test_an_unanswered_list_is_requested_again_until_the_timeout() -> None:
    session = Answering(P=0.5)
    session.answer = lambda message: None
    with pytest.raises(NoReply, match=r"incomplete \(0 of unknown\) after 6 s"):
        read_list(session, exchange(session), 6.0)  # type: ignore[arg-type]
    assert [m.get_type() for m in session.sent] == ["PARAM_REQUEST_LIST"] * 5
    assert {seconds for _, seconds in session.waits} == {1.5}


def test_a_value_without_a_valid_index_has_no_place_in_the_list() -> None:
    session = Answering(P=0.5)
    own = exchange(session)
    for index in (65535, 1, 3):
        session.value("P", index=index)
    session.wait_for(lambda: None, 0.1)
    assert (own.indices, own.count, own.known, own.types) == ({}, 0, {"P": 0.5}, {"P": 9})
    session.value("P", index=0)
    session.wait_for(lambda: None, 0.1)
    assert (own.indices, own.count) == ({0: "P"}, 1)


def test_nothing_can_be_requested_before_a_vehicle_is_discovered() -> None:
    session = Answering(P=0.5)
    session.vehicle = None
    with pytest.raises(NoReply, match="before a vehicle was discovered"):
        exchange(session).request("P")


@pytest.mark.parametrize(("echoes", "sets"), [(0, 3), (2, 3), (1, 2)])
def test_a_write_is_repeated_until_its_echo_arrives(echoes: int, sets: int) -> None:
    """Without any echo it is sent three times, and what the vehicle then holds decides."""
    session = Answering(P=0.5)

    def deaf(message: Any) -> None:
        if message.get_type() != "PARAM_SET":
            session.honest(message)
            return
        session.held["P"] = message.param_value
        if sum(m.get_type() == "PARAM_SET" for m in session.sent) > echoes > 0:
            session.value("P")

    session.answer = deaf
    parameters(session).write("P", 0.75)
    assert sum(m.get_type() == "PARAM_SET" for m in session.sent) == sets


def test_a_write_that_does_not_last_is_repeated_three_times_and_then_reported() -> None:
    session = Answering(P=0.5)

    def undone(message: Any) -> None:
        if message.get_type() == "PARAM_SET":
            session.value("P", message.param_value)
        else:
            session.honest(message)

    session.answer = undone
    with pytest.raises(
        ParameterNotAccepted, match=r'P: wrote 0\.75, but the vehicle reports 0\.5 \(its message: "P: still'
    ) as caught:
        parameters(session).write("P", 0.75)
    assert (caught.value.wanted, caught.value.found) == (0.75, 0.5)
    assert sum(m.get_type() == "PARAM_SET" for m in session.sent) == 3
    assert session.looked_back == [6.0]


def test_a_refused_write_is_sent_once() -> None:
    session = Answering(P=0.5)

    def refusing(message: Any) -> None:
        if message.get_type() == "PARAM_SET":
            session.queue.append(("PARAM_ERROR", SimpleNamespace(param_id="P")))
        else:
            session.honest(message)

    session.answer = refusing
    with pytest.raises(ParameterNotAccepted):
        parameters(session).write("P", 0.75)
    assert sum(m.get_type() == "PARAM_SET" for m in session.sent) == 1


def watched(session: Answering, **values: float) -> tuple[ParamWatch, Callable[..., None]]:
    watch = ParamWatch(session, exchange(session))  # type: ignore[arg-type]
    watch.add(values)

    def hear(name: str, value: float) -> None:
        session.value(name, value)
        session.wait_for(lambda: None, 0.1)

    return watch, hear


def test_an_unexpected_value_is_requested_again_and_is_an_intrusion_when_repeated() -> None:
    session = Answering(P=0.9, Q=1.0)
    session.answer = lambda message: None
    watch, hear = watched(session, P=0.5)
    hear("Q", 7.0)
    hear("P", 0.5)
    assert session.sent == []
    hear("P", 0.9)
    assert (session.asked(), watch.intrusions) == ({"P": 1}, [])
    hear("P", 0.5)
    hear("P", 0.9)
    assert (session.asked(), watch.intrusions) == ({"P": 2}, []), "an echo between clears the suspicion"
    hear("P", 0.8)
    assert (session.asked(), watch.intrusions) == ({"P": 3}, [])
    hear("P", 0.8)
    assert watch.intrusions == [("P", 0.5, 0.8)]
    hear("P", 0.8)
    assert (session.asked(), len(watch.intrusions)) == ({"P": 3}, 1), "a confirmed intrusion is not requested again"


def test_our_own_writes_and_unwatched_parameters_are_not_intrusions() -> None:
    session = Answering(P=0.9)
    session.answer = lambda message: None
    watch, hear = watched(session, P=0.5)
    with watch.writing("P"):
        hear("P", 0.9)
        hear("P", 0.9)
    watch.wrote("P", 0.9)
    watch.wrote("Q", 0.1)
    hear("P", 0.9)
    hear("Q", 0.2)
    assert (session.sent, watch.intrusions) == ([], [])
    hear("P", 0.7)
    watch.drop(["P", "Q"])
    hear("P", 0.7)
    assert (len(session.sent), watch.intrusions) == (1, [])
    watch.add({"P": 0.9})
    hear("P", 0.7)
    assert watch.intrusions == [], "the suspicion starts again"


@pytest.mark.parametrize("scale", [1.0, -1.0, 1e-20, 1e20])
def test_the_last_bits_of_a_float32_are_ignored_and_larger_differences_are_not(scale: float) -> None:
    assert same_float32(scale, scale * (1.0 + 3.9 * 2.0**-24))
    assert same_float32(scale * (1.0 + 3.9 * 2.0**-24), scale)
    assert not same_float32(scale, scale * (1.0 + 4.2 * 2.0**-24))
    assert not same_float32(scale, -scale)


@pytest.mark.parametrize(
    ("a", "b", "same"),
    [
        (math.nan, math.nan, True),
        (math.nan, 0.0, False),
        (math.inf, math.inf, True),
        (math.inf, -math.inf, False),
        (math.inf, 1e38, False),
        (0.0, -0.0, True),
        (0.0, 1e-30, False),
    ],
)
def test_nan_and_infinity_are_compared_too(a: float, b: float, same: bool) -> None:
    assert same_float32(a, b) is same_float32(b, a) is same


def test_a_value_is_rounded_as_the_vehicle_stores_it() -> None:
    assert as_float32("P", 0.1) == 0.10000000149011612
    assert as_float32("P", 3.0) == 3.0


# --- watchdog --------------------------------------------------------------------------------


# --- files --------------------------------------------------------------------------------
