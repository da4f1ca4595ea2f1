"""A scripted vehicle at the far end of a real medium, in simulated time: real sockets and ports, no real waits."""

from __future__ import annotations

from link_ends import PATIENCE, Ends

from gcs_autotune.clock import Deadline, WallClock
from gcs_autotune.link import Peer
from gcs_autotune.link.transports.transport import SteppedTransport
from gcs_autotune.mavlink import split_frames


class Afloat(SteppedTransport):
    """Grants time to *peer* and moves what it and we send over the medium between *ends*."""

    def __init__(self, ends: Ends, peer: Peer) -> None:
        super().__init__(ends.ours.description)
        self.ends, self.peer = ends, peer
        self.is_cut = False

    @property
    def trouble(self) -> str:
        return self.ends.ours.trouble

    def _step(self, grant: float, outgoing: bytes) -> tuple[float, bytes]:
        if outgoing:
            self._carry_over(outgoing)
        sent = self.peer.advance_to(grant)
        if self.is_cut:
            self.ends.ours.read(0.0)
            return grant, b""
        for at in range(0, len(sent), 1400):
            self.ends.send(sent[at : at + 1400])
        came, patience = b"", Deadline.after(WallClock(), PATIENCE)
        while len(came) < len(sent) and not patience.expired:
            came += self.ends.ours.read(patience.remaining)
        assert came == sent, "the medium changed what it carried"
        return grant, came

    def _carry_over(self, outgoing: bytes) -> None:
        frames = split_frames(outgoing)
        for frame in frames:
            self.ends.ours.write(frame)
        if self.is_cut:
            return
        came, patience = b"", Deadline.after(WallClock(), PATIENCE)
        while frames[-1] not in came:
            assert not patience.expired, "the medium lost what we sent"
            came += self.ends.receive()
        self.peer.receive(came)

    def cut(self) -> None:
        """The peer goes away."""
        self.is_cut = True
        if self.ends.hang_up is not None:
            self.ends.hang_up()

    def mend(self) -> None:
        """And comes back."""
        assert self.ends.come_back is not None
        self.ends.come_back()
        self.is_cut = False

    def _close(self) -> None:
        self.ends.ours.close()
