"""Updates of viewers: the whole state once, then changes; a slow viewer does not delay others."""

from __future__ import annotations

import asyncio
import json
from typing import Any

from gcs_autotune.web.live import BEHIND, MOST_VIEWERS, ROWS, WORDS, Live

ROW = [0.0] * 8


def samples(count: int, signal: str = "psi") -> bytes:
    value = {"stage": "a", "manoeuvre": "b", "signal": signal, "rows": [ROW] * count}
    return json.dumps({"samples": value}).encode()


async def next_message(viewer: Any) -> dict[str, Any]:
    return json.loads(await asyncio.wait_for(anext(viewer), 5.0))


def test_a_late_viewer_gets_the_whole_state_once() -> None:
    async def scene() -> None:
        live = Live()
        live.begin({"name": "one"})
        live.take(samples(3))
        live.say("hello")
        viewer = live.watch()
        whole = (await next_message(viewer))["whole"]
        assert len(whole["rows"]) == 3
        assert [w["text"] for w in whole["words"]] == ["hello"]
        assert not live.tell()  # nothing of it comes a second time
        live.take(samples(2, "z"))
        live.tell()
        delta = await next_message(viewer)
        assert [leg["signal"] for leg in delta["+legs"]] == ["z"]
        assert [row[0] for row in delta["+rows"]] == [1, 1]

    asyncio.run(scene())


def test_a_slow_viewer_gets_the_whole_state_again_and_others_every_delta() -> None:
    async def scene() -> None:
        live = Live()
        live.begin({"name": "one"})
        slow, quick = live.watch(), live.watch()
        await next_message(slow)
        await next_message(quick)
        for k in range(3 * BEHIND):
            live.put("now", {"k": k})
            live.tell()
            assert (await next_message(quick))["now"]["k"] == k
        assert (await next_message(slow))["whole"]["now"]["k"] == 3 * BEHIND - 1

    asyncio.run(scene())


def test_memory_does_not_grow_during_a_run() -> None:
    live = Live()
    live.begin({"name": "one"})
    for k in range(60):
        live.take(samples(500))
        live.say(f"sentence {k}")
        live.take(json.dumps({"words": {"severity": 2, "text": "x" * 100_000}}).encode())
        for _ in range(20):
            live.say("again")
    whole = json.loads(live.whole())["whole"]
    assert len(whole["rows"]) == ROWS
    assert len(whole["words"]) == WORDS
    assert len(live.whole()) < 1_500_000


def test_unknown_messages_are_ignored() -> None:
    live = Live()
    live.begin({"name": "one"})
    for line in (b"", b"no json", b"[]", b"{}", b'{"run": {"name": "other"}}', b'{"samples": 3}', b'{"question": "a"}'):
        live.take(line)
    assert live.get("run") == {"name": "one"}
    assert live.get("question") is None


def test_control_characters_do_not_reach_a_viewer() -> None:
    live = Live()
    live.take(json.dumps({"words": {"severity": 4, "text": "\x1b[2J\u202ekept"}}).encode())
    assert json.loads(live.whole())["whole"]["words"][0]["text"] == "\\x1b[2J\\u202ekept"


def test_the_number_of_viewers_is_limited() -> None:
    async def scene() -> None:
        live = Live()
        viewers = [live.watch() for _ in range(MOST_VIEWERS)]
        for viewer in viewers:
            await next_message(viewer)
        assert [text async for text in live.watch()] == []
        await viewers[0].aclose()
        assert "whole" in await next_message(live.watch())

    asyncio.run(scene())


def test_viewers_are_released_at_the_end_without_waiting() -> None:
    async def scene() -> None:
        live = Live()
        viewer, behind = live.watch(), live.watch()
        await next_message(viewer)
        await next_message(behind)
        live.put("now", {})
        live.tell()
        live.close()
        assert [text async for text in viewer] == []
        assert [text async for text in behind] == []
        assert "whole" in await next_message(live.watch())

    asyncio.run(scene())


def test_a_radio_failsafe_is_explained_only_after_the_run_has_released_the_sticks() -> None:
    live = Live()
    for key in ("", "stopping"):
        if key:
            live.put(key, True)
        live.take(b'{"words": {"severity": 2, "text": "PreArm: Radio failsafe on"}}')
        live.take(b'{"words": {"severity": 2, "text": "PreArm: Compass not calibrated"}}')
    notes = [words.get("note", "") for words in json.loads(live.whole())["whole"]["words"]]
    assert [bool(note) for note in notes] == [False, False, True, False]
    assert notes[2].startswith("Expected here: the run no longer sends stick positions")
