"""What to tell when vehicle and ground station do not agree on signing."""

from __future__ import annotations

from gcs_autotune.errors import SigningMismatch
from gcs_autotune.link.discovery import Candidate
from gcs_autotune.link.signing import Refusal, Signer

__all__ = ["cannot_be_commanded", "not_believed", "refusals"]

_CURES = {
    Refusal.UNSIGNED: "it has no key set up on this link: set one up (Mission Planner: Setup, Advanced, MAVLink "
    "Signing; MAVProxy: signing setup), or leave --signing-key out",
    Refusal.WRONG: "this is not the vehicle's key: give the one it was set up with",
    Refusal.OLD: "they may be a recording played back, or the vehicle does not hear us and so does not set its clock",
}


def refusals(signer: Signer | None) -> str:
    """Return how many messages were refused and why, for an error that tells of silence; empty when none were."""
    if signer is None or not signer.refused:
        return ""
    return "refused: " + ", ".join(f"{count} messages {why}" for why, count in signer.refused.most_common())


def not_believed(signer: Signer, description: str) -> SigningMismatch:
    """Return the error for a search in which nobody was heard whom our key lets us believe."""
    worst, _ = signer.refused.most_common(1)[0]
    return SigningMismatch(
        f"messages come in on {description}, but none to be believed ({refusals(signer)}): {_CURES[worst]}"
    )


def cannot_be_commanded(candidate: Candidate, description: str) -> SigningMismatch:
    """Return the error for a vehicle that signs what it says and does not answer us, who have no key."""
    return SigningMismatch(
        f"{candidate} on {description} signs its messages and answers none of ours: it obeys only who signs with its "
        "key; give --signing-key FILE or --signing-passphrase"
    )
