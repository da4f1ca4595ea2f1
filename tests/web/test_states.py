"""Every state of the page: correct, readable, and fitting on phone and desktop, in light and dark mode."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.request import Request, urlopen

import pytest

from .serving import served
from .visiting import Page

pytestmark = [pytest.mark.browser, pytest.mark.slow]

QUESTION, ENDED = "#question-text", "#end-title"


def begun(story: str, **fields: str) -> Callable[[Page], None]:
    """Start the run of a *story*."""

    def reach(page: Page) -> None:
        before = page.page.text_content("#command")
        page.start(connect=f"story:{story}", **fields)
        page.page.wait_for_function(  # the last run may have ended in the same words
            "(before) => document.getElementById('command').textContent !== before", arg=before
        )
        page.shows("#words", "link:") if story == "connecting" else None

    return reach


def shown(story: str, selector: str, text: str, **fields: str) -> Callable[[Page], None]:
    """Start the run of a *story* and wait until *selector* shows *text*."""

    def reach(page: Page) -> None:
        begun(story, **fields)(page)
        page.shows(selector, text)

    return reach


def stopped(page: Page) -> None:
    shown("flying", "#tile-periods", "agree")(page)
    page.page.click("#stop")
    page.stopped()


def job_stopped(page: Page) -> None:
    shown("job", "#tile-periods", "agree", job="all")(page)
    page.page.click("#stop")
    page.stopped()


def stopping(page: Page) -> None:
    shown("stopping", "#tile-periods", "agree")(page)
    page.page.click("#stop")
    page.shows("#stop", "STOPPING")


def declined(page: Page) -> None:
    shown("asking", QUESTION, "Go ahead?")(page)
    page.page.click("#no")
    page.page.locator(ENDED).wait_for()


def undoing(page: Page) -> None:
    shown("kept", ENDED, "done")(page)
    page.page.get_by_role("button", name="Undo").click()
    page.shows(QUESTION, "0.4 \u2192 0.2")


def undone(page: Page) -> None:
    undoing(page)
    page.page.click("#yes")
    page.shows(ENDED, "the old parameters are restored")


def silent(page: Page) -> None:
    shown("flying", "#alarm", "No messages from the vehicle")(page)


def cut_off(page: Page) -> None:
    """The server is killed during a run."""
    with (
        TemporaryDirectory(ignore_cleanup_errors=True) as runs,  # the run may still write when the server is gone
        served(Path(runs), scripted=True, ends_by_kill=True) as link,
    ):
        elsewhere(page, link)
        shown("flying", "#tile-periods", "agree")(page)
    page.shows("#alarm", "No connection to the server")


def looking(page: Page) -> None:
    """Without the token, while a run of another viewer prompts."""
    runs = page.ending.enter_context(TemporaryDirectory())
    link, _, token = page.ending.enter_context(served(Path(runs), scripted=True, host="0.0.0.0")).partition("#")
    order = {"job": "tune", "axis": "heading", "connect": "story:asking"}
    post(link, "start", order, token)
    elsewhere(page, link)
    page.shows(QUESTION, "Go ahead?")


def elsewhere(page: Page, link: str) -> None:
    page.page.goto("about:blank")
    page.called.clear()
    page.link = link
    page.page.goto(link)


def post(link: str, where: str, told: object, token: str = "none") -> dict[str, Any]:
    headers = {"Content-Type": "application/json", "X-Autotune-Token": token}
    request = Request(f"{link.partition('#')[0]}{where}", json.dumps(told).encode(), headers)
    with urlopen(request, timeout=60.0) as answer:
        return dict(json.load(answer))


@pytest.fixture
def at_rest(scripted: str) -> Iterator[str]:
    """The link of the server; whatever runs there is stopped in the end."""
    yield scripted
    while post(scripted, "stop", {})["stopping"]:
        time.sleep(0.1)  # for the process to end


def form(**fields: str) -> Callable[[Page], None]:
    def reach(page: Page) -> None:
        page.page.click("#tab-start")
        for name, value in fields.items():
            page.page.select_option(f"#{name}", value)
        page.page.evaluate("document.querySelectorAll('details').forEach((each) => { each.open = true; })")

    return reach


def opened(page: Page) -> None:
    shown("kept", ENDED, "done")(page)
    page.page.click("#tab-runs")
    page.page.locator("#runs button").first.click()
    page.page.click("#trials li:first-child button")
    page.shows("#play", "Play")
    page.shows("#style-told", "settles in")
    page.page.evaluate("document.querySelectorAll('details').forEach((each) => { each.open = true; })")


@dataclass(frozen=True)
class State:
    """A state of the page: how it is reached, sentences that are true there, and words that would be false."""

    reach: Callable[[Page], None]
    true: tuple[str, ...] = ()
    false: tuple[str, ...] = ()


GONE = ("Undo", "Continue", "Restore the vehicle")
"""Buttons that would change something on a vehicle after its run."""
AS_BEFORE = "Actuators neutral, confirmed at the outputs; mode HOLD, disarmed, as before the run."
NEVER_ARMED = "The run ended before arming. Nothing was moved or written."
NOT_READ = "The run did not record the parameters at its end."

STATES: Mapping[str, State] = {
    "idle": State(lambda page: None, ("No run in progress",), GONE),
    "form of a tune": State(form(job="tune"), ("Start a run",)),
    "form of a manoeuvre": State(form(job="fly", manoeuvre="zig-zag"), ("Start a run",)),
    "connecting": State(begun("connecting"), ("tune heading: starting",), ("Predicted cost", "Mode", *GONE)),
    "asking": State(
        shown("asking", QUESTION, "Go ahead?"),
        ("tune heading: not started", "Waiting for your answer", "yes, and disarms at the end"),
        ("starting", "Predicted cost", "Nearest limit", *GONE),
    ),
    "asking with a preview": State(
        shown("previewed", QUESTION, "Go ahead?", job="fly", manoeuvre="zig-zag"),
        ("47 m of free water", "dashed: predicted"),
        ("Predicted cost",),
    ),
    "flying": State(
        shown("flying", "#tile-periods", "agree"), ("MANUAL, armed", "2 of 5 agree", "about 2 min 0 s left"), GONE
    ),
    "flying a step of a job": State(
        shown("job", "#tile-periods", "agree", job="all"), ("new gains kept", "in progress", "to do"), GONE
    ),
    "asking to write": State(shown("writing", QUESTION, "Write"), ("Waiting for your answer", "quicker <b>turns</b>")),
    "stopping": State(stopping, ("STOPPING: restoring the vehicle",), GONE),
    "stopped": State(stopped, (AS_BEFORE, "all 2 as before the run"), ("MANUAL, armed", *GONE)),
    "declined": State(declined, (NEVER_ARMED, "before arming"), ("restored", NOT_READ, *GONE)),
    "kept": State(
        shown("kept", ENDED, "done"),
        (AS_BEFORE, "ATC_STR_RAT_P 0.2 \u2192 0.4", "16.5 s², 92 % lower", "Undo: restore the old parameters"),
    ),
    "restored": State(
        shown("restored", ENDED, "restored"), (AS_BEFORE, "the new gains were not better in every respect"), GONE
    ),
    "aborted": State(shown("aborted", ENDED, "aborted"), (AS_BEFORE, "--max-speed", "--resume runs/lake"), GONE),
    "lost contact": State(
        shown("lost", ENDED, "failed"),
        ("The state of the craft is unknown. Take over by hand", NOT_READ, "Restore the vehicle"),
        ("Restored", "as before the run", "Undo", "`"),
    ),
    "not restored": State(
        shown("differs", ENDED, "not restored"),
        ("NOT RESTORED (mode: MANUAL, not HOLD)", "Restore the vehicle"),
        ("Restored", "Undo"),
    ),
    "not connected": State(shown("unreachable", ENDED, "failed"), (NEVER_ARMED,), ("Restored", NOT_READ, *GONE)),
    "job stopped": State(
        job_stopped,
        ("speed: the new gains are better and stay", "line: not flown", "Continue with the next step", "Undo"),
        ("in progress",),
    ),
    "all loops done": State(
        shown("done", ENDED, "done", job="all"),
        ("heading: the new gains were not better in every respect", "Undo"),
        ("Continue",),
    ),
    "undoing": State(undoing, ("Write ATC_STR_RAT_P 0.4 \u2192 0.2?",), ("starting", *GONE)),
    "undone": State(undone, ("verified by reading back",), GONE),
    "runs": State(
        opened, ("Recorded, not live", "Prove this on the vehicle", "\N{RIGHTWARDS ARROW} 0.4"), ("Continue",)
    ),
    "vehicle silent": State(silent, ("No messages from the vehicle for",), GONE),
    "server lost": State(
        cut_off, ("No connection to the server for", "if the server has ended, it stops and restores the vehicle")
    ),
    "view only": State(looking, ("View only: this page was opened without the token",)),
}
"""Each state of the page by name."""

LOOKS = [(width, scheme) for width in (390, 1280) for scheme in ("light", "dark")]
BROKEN = """() => {
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT), found = [], boxes = [];
  const range = document.createRange();
  for (let node = texts.nextNode(); node; node = texts.nextNode()) {
    const within = node.parentElement;
    if (!within.checkVisibility() || within.closest("select, option, .uplot, #latest, pre, #runs button")) continue;
    for (const { 0: word, index } of node.data.matchAll(/[^\\s\\-\\/]+/g)) {
      range.setStart(node, index); range.setEnd(node, index + word.length);
      const rects = [...range.getClientRects()];
      if (word.length <= 16 && new Set(rects.map((rect) => rect.top)).size > 1) found.push(`broken: ${word}`);
      for (const rect of rects) boxes.push({ word, node, rect });
    }
  }
  boxes.forEach((one, k) => boxes.slice(k + 1).forEach((other) => {
    const [a, b] = [one.rect, other.rect];
    const wide = Math.min(a.right, b.right) - Math.max(a.left, b.left);
    const high = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
    const hides = [one, other].some((each) => each.node.parentElement.closest("#words, #bar, .scroll"));
    if (one.node !== other.node && wide > 2 && high > 6 && !hides) found.push(`${one.word} over ${other.word}`);
  }));
  const all = [...document.querySelectorAll("button, dd, dt, th, td, h1, h2, h3, p, li, label, small, figcaption")];
  for (const node of all.filter((each) => each.checkVisibility() && each.clientWidth && !each.closest(".uplot")))
    if (node.scrollWidth > node.clientWidth + 1) found.push(`clipped: ${node.textContent.slice(0, 40)}`);
  return found;
}"""
"""Words that are broken or cover each other, and texts that are cut off."""


@pytest.mark.parametrize("name", STATES)
def test_each_state_is_correct_and_readable_on_phone_and_desktop_in_both_colour_schemes(
    visit: Any, at_rest: str, barriers: Any, name: str
) -> None:
    state, page = STATES[name], visit(at_rest)
    state.reach(page)
    for text in state.true:
        page.shows("body", text)
    shown = page.page.inner_text("#bar") + page.page.inner_text("main").replace(page.page.inner_text("footer"), "")
    assert [text for text in state.false if text in shown] == []
    is_running = page.page.is_enabled("#stop")
    assert is_running <= page.page.is_visible("#progress")
    assert page.page.is_visible("#tiles") <= page.page.is_visible("#progress")
    for width, scheme in LOOKS:
        page.page.set_viewport_size({"width": width, "height": 844})
        page.page.emulate_media(color_scheme=scheme)
        page.page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        assert page.page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.page.evaluate(BROKEN) == []
        assert barriers(page.page) == []
    page.page.close()
    page.troubles[:] = [one for one in page.troubles if "ERR_CONNECTION_REFUSED" not in one]  # of a server that ended


def test_broken_overlapping_or_truncated_words_are_detected(visit: Any, scripted: str) -> None:
    page = visit(scripted)
    assert page.page.evaluate(BROKEN) == []
    wrong = {
        "stop": "width: 3rem; min-width: 0",
        "tab-start": "margin-left: -4rem",
        "tab-runs": "width: 3rem; white-space: nowrap",
    }
    page.page.evaluate(
        "(wrong) => Object.entries(wrong).forEach(([id, s]) => { document.getElementById(id).style = s; })", wrong
    )
    assert {"broken: STOP", "Live over Start", "clipped: Runs and logs"} <= set(page.page.evaluate(BROKEN))


def test_a_page_in_a_frame_of_zero_width_can_stop_the_run(visit: Any, at_rest: str) -> None:
    page = visit(at_rest)
    shown("previewed", QUESTION, "Go ahead?", job="fly", manoeuvre="zig-zag")(page)
    page.page.evaluate("document.getElementById('charts').style.width = '0'")
    page.page.emulate_media(color_scheme="dark")  # plot every figure again
    page.page.keyboard.press("Space")
    page.stopped()


# --- by keyboard alone --------------------------------------------------------------------------------------------

REACHABLE = "a[href], button:enabled, input:enabled, select:enabled, summary, [tabindex='0']"
FOCUS = """(wanted) => {
  const node = document.activeElement;
  if (!node || node === document.body) return null;
  const style = getComputedStyle(node), box = node.getBoundingClientRect(), bar = document.getElementById("bar");
  const above = node.closest("#bar") ? 0 : bar.getBoundingClientRect().bottom;
  const seen = style.outlineStyle !== "none" && parseFloat(style.outlineWidth) >= 2
    && style.outlineColor !== getComputedStyle(node.closest("section, body")).backgroundColor;
  const shown = box.top >= above - 1 && box.bottom <= innerHeight + 1 || box.height > innerHeight - above;
  const scrolls = node.scrollWidth > node.clientWidth || node.scrollHeight > node.clientHeight;
  const number = [...document.querySelectorAll(wanted)].filter((each) => each.checkVisibility()).indexOf(node);
  if (number < 0 && scrolls) return { number: "scrolls" };  // what is wider than the page is scrolled with the arrows
  return { number, name: node.id || node.textContent.slice(0, 30), seen, shown };
}"""
"""What has the focus, its number among what can be reached, and whether it is marked and on the screen."""


def walk(page: Page) -> list[dict[str, Any]]:
    """Press Tab from the top of the page until its end and return what got the focus."""
    page.page.locator("#stage").evaluate("node => { node.tabIndex = -1; node.focus(); node.blur(); scrollTo(0, 0); }")
    found: list[dict[str, Any]] = []
    for _ in range(200):
        page.page.keyboard.press("Tab")
        at = page.page.evaluate(FOCUS, REACHABLE)
        if at is None or (found and at["number"] == found[0]["number"]):
            return found
        found += [at] if at["number"] != "scrolls" else []
    raise AssertionError("Tab never comes to the end of the page")


@pytest.mark.parametrize("width", [390, 1280])
@pytest.mark.parametrize(
    "name", ["form of a manoeuvre", "asking to write", "kept", "job stopped", "lost contact", "runs"]
)
def test_tab_reaches_every_control_in_order_with_visible_focus(visit: Any, at_rest: str, name: str, width: int) -> None:
    page = visit(at_rest, viewport={"width": width, "height": 844})
    STATES[name].reach(page)
    for text in STATES[name].true:
        page.shows("body", text)
    found = walk(page)
    controls = page.page.locator(REACHABLE).locator("visible=true").all()
    assert [each["number"] for each in found] == list(range(len(controls))), [each["name"] for each in found]
    assert [each["name"] for each in found if not (each["seen"] and each["shown"])] == []


def press(page: Page, name: str, key: str = "Enter") -> None:
    """Press Tab until the control *name* has the focus, then *key*."""
    for _ in range(200):
        page.page.keyboard.press("Tab")
        if (page.page.evaluate(FOCUS, REACHABLE) or {}).get("name", "").startswith(name):
            return page.page.keyboard.press(key)
    raise AssertionError(f"{name} is not reached by Tab")


def test_a_run_is_undone_by_keyboard_alone(visit: Any, at_rest: str) -> None:
    page = visit(at_rest)
    STATES["kept"].reach(page)
    page.shows("#end-offer", "Undo")
    press(page, "Undo")
    page.shows(QUESTION, "0.4 \u2192 0.2")
    assert page.page.evaluate("document.activeElement.id") == "question"
    press(page, "yes")
    page.shows(ENDED, "the old parameters are restored")


def test_a_job_is_continued_and_stopped_by_keyboard_alone(visit: Any, at_rest: str) -> None:
    page = visit(at_rest)
    job_stopped(page)
    page.shows("#end-offer", "Continue")
    press(page, "Continue")
    page.page.locator("#stop:enabled").wait_for()
    assert "--resume=" in page.page.inner_text("#command")
    press(page, "stop")
    page.stopped()


def test_a_run_is_selected_replayed_and_its_gentle_gains_proved_by_keyboard_alone(visit: Any, at_rest: str) -> None:
    page = visit(at_rest)
    STATES["kept"].reach(page)
    name = page.page.evaluate("fetch('runs').then((a) => a.json()).then((told) => told.entries[0].name)")
    press(page, "tab-runs")
    press(page, "filter", "Space")
    page.page.keyboard.type("kept")
    press(page, name[:30])
    page.shows("#entry-title", name)
    page.shows("#style-told", "settles in")
    press(page, "style-slider", "ArrowLeft")
    assert page.page.inner_text("#style-name") == "gentle"
    press(page, "02-step-before")
    page.shows("#at-time", "29.9 s")
    press(page, "replay-close")
    press(page, "prove")
    page.shows("#command", "--style=gentle")
