"""Senders by sequence number: both protocols, two that interleave, others reported once, a vehicle that moved."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from gcs_autotune.link.liveness import HeldSender, Liveness
from gcs_autotune.mavlink import Frame, VehicleIdentity

HOME, ELSEWHERE = "10.0.0.1:14550", "10.0.0.66:14550"


def numbered(sequence: int, v1: bool = False, origin: str = "") -> Frame:
    """A frame of the protocol's first or second version, whose other bytes are no sequence numbers."""
    raw = bytes([0xFE, 9, sequence, 77, 88, 99]) if v1 else bytes([0xFD, 9, 77, 88, sequence, 99])
    return Frame(raw, None, "HEARTBEAT", 1, 1, origin)


def count_notes(sequences: list[int], v1: bool = False) -> int:
    notes: list[str] = []
    sender = HeldSender(notes)
    for sequence in sequences:
        sender.hear(numbered(sequence % 256, v1))
    assert all("interleave" in note for note in notes)
    return len(notes)


def interleaved(turns: int, begin: int = 0, apart: int = 100) -> list[int]:
    """Two senders, one frame of each in turn; the first has begun to speak *turns* times at the end."""
    return [n for k in range(turns) for n in (begin + k, begin + apart + k)][:-1]


@pytest.mark.parametrize("v1", [True, False])
@pytest.mark.parametrize("begin", [0, 253])
def test_two_senders_are_reported_once_after_five_frames_of_each(v1: bool, begin: int) -> None:
    assert count_notes(interleaved(5, begin), v1) == 0
    assert count_notes(interleaved(6, begin), v1) == 1
    assert count_notes(interleaved(40, begin), v1) == 1
    assert count_notes(list(range(begin, begin + 600)), v1) == 0


def test_at_most_sixteen_sequences_are_followed() -> None:
    """Seventeen interleaved senders exceed the limit, so none of them is followed."""
    in_turn = [[n for k in range(8) for n in range(0, 10 * count, 10)] for count in (16, 17)]
    every = [[(n + k // count) % 256 for k, n in enumerate(row)] for count, row in zip((16, 17), in_turn, strict=True)]
    assert [count_notes(row) for row in every] == [1, 0]


def test_without_an_origin_every_frame_is_from_the_held_sender() -> None:
    sender = HeldSender([])
    assert sender.is_held(numbered(1))
    assert not sender.is_held(numbered(1, origin=ELSEWHERE))
    sender.hold(HOME)
    assert sender.is_held(numbered(1, origin=HOME))


def test_other_senders_are_reported_once_each_when_the_held_sender_is_heard_again() -> None:
    notes: list[str] = []
    sender = HeldSender(notes)
    sender.hold(HOME)
    sender.hear(numbered(1, origin=HOME))
    for _ in range(2):
        for k in range(2):
            sender.note_other_sender(Frame(b"", None, "HEARTBEAT", 3, 9, f"{ELSEWHERE}{k}"))
        assert len(notes) in (0, 2), "the vehicle may have moved to another port"
        sender.hear(numbered(2, origin=HOME))
        assert len(notes) == 2
    assert f"another sender at {ELSEWHERE}0 uses the vehicle's ids (system 3, component 9)" in notes[0]
    assert f"the vehicle is at {HOME}. The other sender is ignored" in notes[0]
    for k in range(40):
        sender.note_other_sender(Frame(b"", None, "HEARTBEAT", 3, 9, f"many {k}"))
        sender.hear(numbered(3 + k, origin=HOME))
    assert len(notes) == 20


def test_a_sender_that_proves_to_be_the_vehicle_is_not_reported_as_another() -> None:
    notes: list[str] = []
    sender = HeldSender(notes)
    sender.hold(HOME)
    sender.note_other_sender(Frame(b"", None, "HEARTBEAT", 1, 1, ELSEWHERE))
    sender.hold(ELSEWHERE, VehicleIdentity(1, 1, 3, 11, uid="ab"))
    sender.hear(numbered(1, origin=ELSEWHERE))
    assert notes == [
        f"the vehicle now sends from {ELSEWHERE}, not {HOME} (restarted?): its board's id is the same",
    ]
    sender.hold(HOME, VehicleIdentity(1, 1, 3, 11))
    assert notes[1].endswith("its board reports no id, but its firmware is the same")


def introduced(uid: int = 0, word: int = 0x04060000 + 255, name: str = "AUTOPILOT_VERSION") -> Frame:
    message: Any = SimpleNamespace(uid=uid, uid2=bytes(18), flight_sw_version=word)
    return Frame(b"", message, name, 1, 1, ELSEWHERE)


@pytest.mark.parametrize(
    ("frame", "uid", "known"),
    [
        (introduced(0xAB), "ab", True),
        (introduced(0xAC), "ab", False),
        (introduced(0), "ab", False),
        (introduced(0), "", True),
        (introduced(0xAB), "", False),
        (introduced(0, 0x04070000 + 255), "", False),
        (introduced(0xAB, name="HEARTBEAT"), "ab", False),
    ],
)
def test_a_vehicle_is_recognised_by_its_board_or_without_an_id_by_its_firmware(
    frame: Frame, uid: str, known: bool
) -> None:
    assert HeldSender([]).may_be(frame, VehicleIdentity(1, 1, 3, 11, version="4.6.0", uid=uid)) is known


def listened(liveness: Liveness, seconds: float) -> None:
    for _ in range(round(4.0 * seconds)):
        liveness.count(liveness._last_pump + 0.25)


def test_the_longest_of_several_silences_is_reported_while_its_end_is_in_the_span() -> None:
    liveness = Liveness(0.0)
    for seconds in (1.0, 4.0, 2.0):
        listened(liveness, seconds)
        liveness.heard()
    assert [liveness.longest(span) for span in (0.0, 1.75, 2.0, 9.0)] == [2.0, 2.0, 4.0, 4.0]
    for _ in range(60):
        listened(liveness, 1.0)
        liveness.heard()
    assert liveness.longest(1e9) == 1.0, "fifty are kept"


def test_only_time_spent_listening_counts_as_silence() -> None:
    """A gap between pumps counts at most half a second: in a longer one this program was away."""
    hearing = Liveness(100.0)
    hearing.count(100.4)
    assert (hearing.listened, hearing.silence) == (pytest.approx(0.4), pytest.approx(0.4))
    hearing.count(160.4)
    assert hearing.silence == pytest.approx(0.9)
    hearing.heard()
    hearing.count(160.6)
    assert (hearing.listened, hearing.silence) == (pytest.approx(1.1), pytest.approx(0.2))
    hearing.bear(20.0)
    assert hearing.silence == pytest.approx(-20.0)


@pytest.mark.parametrize(("silence", "is_kept"), [(0.5, False), (0.51, True)])
def test_the_longest_silence_ignores_short_ones_and_those_outside_the_span(silence: float, is_kept: bool) -> None:
    liveness = Liveness(0.0)

    def listen(until: float) -> None:
        now = begun[0]
        while now < until - 1e-9:
            now = min(now + 0.3, until)
            liveness.count(now)
        begun[0] = until

    begun = [0.0]
    listen(silence)
    liveness.heard()
    listen(silence + 0.2)
    liveness.heard()
    assert liveness.longest(10.0) == (pytest.approx(silence) if is_kept else 0.0)
    listen(silence + 5.0)
    assert liveness.longest(5.1) == (pytest.approx(silence) if is_kept else 0.0)
    assert liveness.longest(4.9) == 0.0
    liveness.bear(3.0)
    assert (liveness.silence, liveness.actual_silence) == (pytest.approx(-3.0), pytest.approx(4.8))
    liveness.heard()
    assert liveness.longest(1.0) == pytest.approx(4.8), "a tolerated silence still counts"
