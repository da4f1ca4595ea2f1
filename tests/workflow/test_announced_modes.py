"""The modes that an announcement lists."""

from __future__ import annotations

import pytest

from gcs_autotune.workflow.announcement import modes_then


@pytest.mark.parametrize(
    ("used", "back", "told"),
    [
        (["MANUAL"], "HOLD", "MANUAL, then HOLD again"),
        (["GUIDED", "MANUAL"], "HOLD", "GUIDED and MANUAL, then HOLD again"),
        (["MANUAL"], "MANUAL", "MANUAL"),
        (["GUIDED", "MANUAL"], "MANUAL", "GUIDED and MANUAL, then MANUAL"),
        (["AUTO", "GUIDED", "MANUAL"], "GUIDED", "AUTO, GUIDED and MANUAL, then GUIDED"),
    ],
)
def test_a_mode_is_listed_once_if_it_is_the_only_one(used: list[str], back: str, told: str) -> None:
    assert modes_then(used, back) == told
