"""What every transport inherits: waiting by its own clock, being closed, finding the other end again, granted time."""

from __future__ import annotations

import math

import pytest

from gcs_autotune.clock import ManualClock
from gcs_autotune.errors import LinkLost
from gcs_autotune.link import Transport
from gcs_autotune.link.transports import transport as transport_module
from gcs_autotune.link.transports.transport import ReconnectingTransport, SteppedTransport, _round_up


class Bare(Transport):
    """Returns the supplied pieces, one per read, each after a tenth of a second."""

    def __init__(self, *pieces: bytes) -> None:
        super().__init__("bare:", ManualClock(10.0))
        self.pieces, self.written, self.closings = list(pieces), b"", 0
        self.timeouts: list[float] = []

    def _read_available(self, timeout: float) -> bytes:
        self.timeouts.append(timeout)
        assert isinstance(self._clock, ManualClock)
        self._clock.advance(min(0.1, timeout))
        return self.pieces.pop(0) if self.pieces else b""

    def _write(self, data: bytes) -> None:
        self.written += data

    def _close(self) -> None:
        self.closings += 1


def test_a_read_waits_for_data_until_its_timeout() -> None:
    link = Bare(b"", b"", b"word", b"more")
    assert link.read(1.0) == b"word"
    assert link.timeouts == pytest.approx([1.0, 0.9, 0.8])
    assert link.clock.now() == pytest.approx(10.3)
    silent = Bare()
    assert silent.read(0.25) == b""
    assert silent.timeouts == pytest.approx([0.25, 0.15, 0.05])
    assert Bare(b"word").read(0.0) == b"word"
    for timeout in (0.0, -1.0):
        once = Bare()
        assert once.read(timeout) == b""
        assert once.timeouts == [0.0]


def test_a_closed_link_raises_link_lost_and_is_closed_once() -> None:
    with Bare(b"word") as link:
        link.write(b"")
        link.write(b"ab")
        link.write(b"c")
        assert link.written == b"abc"
    link.close()
    assert link.closings == 1
    for act in (lambda: link.read(1.0), lambda: link.write(b"x"), lambda: link.write(b"")):
        with pytest.raises(LinkLost, match="the link bare: has been closed"):
            act()
    assert str(link.lost("why", "do this")) == "link bare: lost: why. To fix it: do this"


def test_a_plain_link_has_default_properties() -> None:
    link = Bare()
    link.follow_tick(1.0, 2.0)
    link.hold("somebody")
    assert (link.description, link.carrier, link.trouble, link.origin) == ("bare:", "", "", "")
    assert not link.is_simulated
    assert link.repeat_period == 0.04, "a dozen in the half second after which a pilot counts as lost"


class Dropping(ReconnectingTransport):
    """Breaks with ``breaks``; comes back when ``back`` is set."""

    def __init__(self) -> None:
        super().__init__("dropping:")
        self._clock = ManualClock(10.0)
        self.breaks: Exception | None = None
        self.back, self.hung_up, self.calls, self.sent = False, 0, 0, b""

    def _receive(self, timeout: float) -> bytes:
        if self.breaks is not None:
            raise self.breaks
        return b"word"

    def _send(self, data: bytes) -> None:
        if self.breaks is not None:
            raise self.breaks
        self.sent += data

    def _hang_up(self) -> None:
        self.hung_up += 1

    def _call_again(self) -> bool:
        self.calls += 1
        self.breaks = None if self.back else self.breaks
        return self.back

    def _loss(self, error: Exception) -> LinkLost:
        return self.lost(str(error), "wait")


@pytest.mark.parametrize("error", [OSError("gone"), EOFError("gone"), TypeError("gone")], ids=repr)
@pytest.mark.parametrize("by", ["read", "write"])
def test_a_lost_link_is_reported_once_and_reconnection_is_tried_every_second(
    monkeypatch: pytest.MonkeyPatch, error: Exception, by: str
) -> None:
    if by == "write" and not isinstance(error, OSError):
        return
    link, waited = Dropping(), list[float]()
    clock = link.clock
    assert isinstance(clock, ManualClock)
    monkeypatch.setattr(transport_module, "idle", lambda seconds: waited.append(seconds) or clock.advance(seconds))
    assert link.read(1.0) == b"word"
    link.breaks = error
    with pytest.raises(LinkLost, match=r"link dropping: lost: gone\. To fix it: wait") as caught:
        link.read(1.0) if by == "read" else link.write(b"x")
    assert caught.value.__cause__ is error
    assert link.hung_up == 1
    link.write(b"dropped meanwhile, as by a radio")
    assert link.read(0.4) == b""
    assert (waited, link.calls) == ([pytest.approx(0.4)], 0)
    assert link.read(0.9) == b""
    assert waited[1:2] == [pytest.approx(0.6)], "no longer than until the next look"
    assert link.calls >= 1
    calls = link.calls
    link.back = True
    clock.advance(1.0)
    assert link.read(0.5) == b"word"
    assert link.calls == calls + 1
    link.write(b"heard")
    assert link.sent == b"heard"
    link.close()
    assert link.hung_up == 2


class Stepped(SteppedTransport):
    """Records grants and data; reports a time ``beyond`` its grant."""

    def __init__(self, beyond: float = 0.0) -> None:
        super().__init__("stepped:", 0.1)
        self.grants: list[float] = []
        self.handed: list[bytes] = []
        self.beyond, self.says = beyond, [b""]

    def _step(self, grant: float, outgoing: bytes) -> tuple[float, bytes]:
        self.grants.append(grant)
        self.handed.append(outgoing)
        return grant + self.beyond, self.says.pop(0) if self.says else b""

    def _close(self) -> None: ...


def test_time_is_granted_to_the_next_tick_with_the_bytes_written() -> None:
    link = Stepped()
    assert link.is_simulated
    link.write(b"ab")
    link.write(b"c")
    assert link.read(0.25) == b""
    assert link.grants == pytest.approx([0.1, 0.2, 0.25])
    assert link.handed == [b"abc", b"", b""]
    assert link.clock.now() == pytest.approx(0.25)
    assert link.read(0.0) == b""
    assert link.grants[-1] == pytest.approx(0.25), "no time, no grant"
    link.read(0.2)
    assert link.grants[4:] == pytest.approx([0.3, 0.4, 0.45])


def test_ticks_are_counted_from_the_tick_being_followed() -> None:
    link = Stepped()
    link.follow_tick(0.03, 0.2)
    link.read(0.5)
    assert link.grants == pytest.approx([0.03, 0.23, 0.43, 0.5])
    at = Stepped()
    at.follow_tick(0.0, 0.1)
    at.read(0.1)
    at.read(0.1)
    assert at.grants == pytest.approx([0.1, 0.2]), "a tick is not granted twice, whatever rounding says"


def test_the_clock_follows_the_other_end_and_never_runs_back() -> None:
    ahead, behind = Stepped(0.02), Stepped(-0.02)
    ahead.says, behind.says = [b"x"], [b"x"]
    assert ahead.read(0.1) == b"x"
    assert ahead.clock.now() == pytest.approx(0.12)
    assert behind.read(0.1) == b"x"
    assert behind.clock.now() == pytest.approx(0.1)


def test_a_grant_is_rounded_up_to_a_whole_nanosecond() -> None:
    for t in (0.1 + 0.2, 1.0 / 3.0, 5.0, math.pi):
        assert 0.0 <= _round_up(t) - t + 1e-16 * t < 1.1e-9
