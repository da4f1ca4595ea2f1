"""Access: who may view and who may operate."""

from __future__ import annotations

import pytest
from starlette.datastructures import Headers

from gcs_autotune.web import Access
from gcs_autotune.web.access import TOKEN_HEADER, WITHIN, WRONG, is_loopback


class Watch:
    t = 0.0

    def __call__(self) -> float:
        return self.t


def trouble(access: Access | None = None, **headers: str) -> str:
    return (access or Access()).trouble_with_host(Headers({k.replace("_", "-"): v for k, v in headers.items()}))


@pytest.mark.parametrize("host", ["127.0.0.1:8090", "localhost:8090", "[::1]:8090", "192.168.2.2", "blueos.local"])
def test_local_names_are_accepted(host: str) -> None:
    assert trouble(host=host) == ""


@pytest.mark.parametrize(
    "host", ["evil.example", "localhost.evil.example", "", "evil.example:8090", "127.0.0.1.nip.io"]
)
def test_a_foreign_host_name_is_rejected(host: str) -> None:
    assert "not a known name of this server" in trouble(host=host)


def test_a_name_may_be_allowed() -> None:
    assert trouble(Access(hosts=["Boat.example"]), host="boat.example", origin="http://boat.example") == ""


def test_a_foreign_page_is_rejected_by_origin_or_fetch_metadata() -> None:
    assert "evil.example" in trouble(host="127.0.0.1:8090", origin="http://evil.example")
    assert "another port" not in trouble(host="127.0.0.1:8090", origin="http://127.0.0.1:8090")
    assert trouble(host="127.0.0.1:8090", origin="http://127.0.0.1:9999") != ""
    assert "another page" in trouble(host="127.0.0.1:8090", sec_fetch_site="cross-site")
    assert trouble(host="127.0.0.1:8090", origin="null") != ""


def test_only_the_token_grants_access_and_a_missing_one_is_explained() -> None:
    access = Access("right")
    assert access.refusal(Headers({TOKEN_HEADER: "right"}), "a") is None
    assert access.refusal(Headers({}), "a") == (401, access.refusal(Headers({}), "a")[1])  # type: ignore[index]
    assert access.refusal(Headers({TOKEN_HEADER: "wrong"}), "a")[0] == 403  # type: ignore[index]
    assert access.refusal(Headers({TOKEN_HEADER: "rïght"}), "a")[0] == 403  # type: ignore[index]


def test_guessing_is_limited_per_address_and_never_locks_out_the_owner() -> None:
    watch = Watch()
    access = Access("right", now=watch)
    wrong = Headers({TOKEN_HEADER: "wrong"})
    statuses = [access.refusal(wrong, "guesser")[0] for _ in range(WRONG + 5)]  # type: ignore[index]
    assert statuses == [403] * WRONG + [429] * 5
    assert access.refusal(wrong, "other")[0] == 403  # type: ignore[index]
    assert access.refusal(Headers({TOKEN_HEADER: "right"}), "guesser") is None
    watch.t = WITHIN + 1.0
    assert access.refusal(wrong, "guesser")[0] == 403  # type: ignore[index]


def test_tokens_differ_and_are_long() -> None:
    assert len({Access.new_token() for _ in range(50)}) == 50
    assert len(Access.new_token()) >= 22


def test_only_loopback_addresses_count_as_this_machine() -> None:
    assert [h for h in ("127.0.0.1", "127.9.9.9", "::1", "localhost") if not is_loopback(h)] == []
    assert [h for h in ("0.0.0.0", "::", "192.168.1.2", "boat.local") if is_loopback(h)] == []
