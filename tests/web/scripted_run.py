"""Replaces a run of our command line: prints the same messages, prompts, and obeys STOP. Flies nothing.

Its messages are one of :data:`STORIES`, named by the link ``story:NAME``; the default is a tune that prompts.
An undo of a run (``params restore``) is the story ``undo``.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

try:
    import fcntl
except ImportError:  # no POSIX
    fcntl = None  # type: ignore[assignment]

Tale = Iterable[tuple[str, object]]

ROW = [1.0, 0.1, 0.2, 0.3, 0.01, 1.0, 2.0, 0.1]
PROGRESS = {"stage": "first self-oscillation", "signal": "psi", "step": 3, "steps": 8, "elapsed": 60.0, "left": 120.0}
OLD = {"ATC_STR_RAT_P": 0.2, "ATC_STR_RAT_I": 0.2}
NEW = {**OLD, "ATC_STR_RAT_P": 0.4}
PROPOSAL = {
    "values": [{"parameter": "ATC_STR_RAT_P", "old": 0.2, "new": 0.4, "reason": "quicker <b>turns</b>"}],
    "cost_before": 10.0,
    "cost_after": 2.0,
    "cost_worst": 3.0,
}
ARMS = {"text": "arm the vehicle, and disarm it at the end", "row": "Arms", "brief": "yes, and disarms at the end"}
ANNOUNCED = [("intentions", {"each": [ARMS], "texts": [ARMS["text"]]}), ("say", f"will {ARMS['text']}")]
STEPS = [
    {"name": "speed", "state": "kept", "reason": "better", "seconds": 100.0},
    {"name": "heading", "state": "flying", "reason": "", "seconds": 200.0},
    {"name": "line", "state": "open", "reason": "", "seconds": 300.0},
]
ASKED: Tale = [
    *ANNOUNCED[:1],
    ("steps", {"steps": STEPS}),
    *ANNOUNCED[1:],
    ("words", {"severity": 4, "text": "<img src=x onerror=alert(1)>\x1b[2J"}),
    ("samples", {"stage": "first self-oscillation", "manoeuvre": "relay", "signal": "psi", "rows": [ROW] * 3}),
    ("now", PROGRESS),
    ("proposal", PROPOSAL),
    ("question", {"id": 1, "text": "Go ahead?"}),
]
HOLD = {"mode": "HOLD", "armed": False, "differs": {}}
NOT_HOLD = {"mode": "MANUAL", "armed": True, "differs": {"mode": "MANUAL, not HOLD"}}
FLOWN = [
    "tracking error (ITAE) 197 -> 16.5 s^2, 92% lower",
    "overshoot 126.9% -> 19.4% of the step",
    "remaining oscillation 86.5% -> 1.9% of the step",
]
STOPPED = "stopped by the operator"


def vitals(mode: str, *, armed: bool) -> tuple[str, object]:
    values = {"battery_voltage": 12.46, "battery_remaining": 0.98, "round_trip": 0.1, "attitude_rate": 10.0}
    return "vitals", {"mode": mode, "armed": armed, **values}


def oscillating() -> Tale:
    """An oscillation of the heading under a relay, half a minute long."""
    rows = []
    for k in range(300):
        t, phase = 0.1 * k, 2.0 * math.pi * k / 90.0
        psi = 0.7 + 0.25 * math.sin(phase)
        x, y = 1.2 * t * math.cos(0.7), 1.2 * t * math.sin(0.7)
        rows.append([t, psi, 0.7, math.copysign(0.3, -math.sin(phase)), 0.17 * math.cos(phase), x, y, psi])
    t, value, target, output, rate, x, y, psi = rows[-1]
    here = {"t": t, "value": value, "target": target, "output": output, "rate": rate, "x": x, "y": y, "psi": psi}
    guard = {"guard": "distance from start", "guard_share": 0.52, "periods": 2, "periods_needed": 5}
    return [
        ("room", {"x": 0.0, "y": 0.0, "distance": 120.0, "zones": [], "bounds": {"psi": [-0.3, 1.7]}}),
        ("samples", {"stage": "first self-oscillation", "manoeuvre": "relay", "signal": "psi", "rows": rows}),
        ("cost", {"nominal": 15.5, "worst": 16.4}),
        ("now", {**PROGRESS, "manoeuvre": "relay", **guard, **here}),
    ]


FLYING: Tale = [
    *ANNOUNCED,
    ("say", "first self-oscillation"),
    vitals("MANUAL", armed=True),
    ("words", {"severity": 6, "text": "Throttle armed"}),
    *oscillating(),
]
TRACK = {
    "run": "zig-zag",
    "x": 0.0,
    "y": 0.0,
    "psi": 0.6,
    "ahead": [float(k) for k in range(45)],
    "abeam": [3.0 * math.sin(0.2 * k) for k in range(45)],
    "told": "42 s, 47 m of free water, 50\u00b0 of turning at up to 11\u00b0/s",
    "trouble": "",
}


@dataclass(frozen=True)
class Story:
    """The messages until an answer or a STOP, and how the run ends.

    messages : as sent. waits : whether an answer or a STOP is awaited; ``stops``: how many. code, error, left : exit
    code, last message and final state of the vehicle, after a yes or without waiting; any other end is a STOP with
    ``left``. ending, after : ending of the summary, and the parameters at the end. journal : whether it is left open
    or closed; None: there is none. files : others by name.
    """

    messages: Tale
    waits: bool = True
    stops: int = 1
    code: int = 0
    error: str = ""
    left: Mapping[str, Any] | None = field(default_factory=lambda: HOLD)
    ending: str = ""
    flown: list[str] = field(default_factory=list)
    after: Mapping[str, float] | None = field(default_factory=lambda: OLD)
    journal: str | None = None
    files: Mapping[str, str] = field(default_factory=dict)


def step_of(size: float) -> str:
    """A recorded step of the heading that overshoots by *size* [fraction of the step]."""
    lines = ["t[s],psi[rad],r[rad/s],N[1]"]
    for k in range(300):
        t = 0.1 * k
        psi = 0.5 * (1.0 - math.exp(-0.3 * t) * (math.cos(t) + size * math.sin(t)))
        lines.append(f"{t:.1f},{psi:.5f},0.0,{0.5 - psi:.4f}")
    return "\n".join(lines) + "\n"


def trial(name: str, size: float) -> dict[str, str]:
    marks = [{"t": 0.0, "kind": "target", "detail": {"value": 0.5}}]
    meta = {"name": name, "ending": "completed", "meta": {"signal": "psi", "force": "N"}, "marks": marks}
    return {f"trials/{name}.csv": step_of(size), f"trials/{name}.json": json.dumps(meta)}


def job(*endings: str) -> str:
    gains = {"ATC_STR_RAT_P": [0.2, 0.4]}
    names = ("speed", "heading", "line")
    steps = [{"name": n, "ending": e, "gains": gains} for n, e in zip(names, endings, strict=True)]
    return json.dumps({"style": "normal", "dry_run": False, "steps": steps})


def styles() -> str:
    """Designs from gentle to quick of which each changes one gain."""
    t, made = [0.5 * k for k in range(20)], []
    for k, name in enumerate(("gentle", "50", "quick")):
        curve = [0.5 * (1.0 - math.exp(-(0.2 + 0.2 * k) * each)) for each in t]
        step = {"size": 0.5, "t": t, **dict.fromkeys(("before", "after", "low", "high", "output"), curve)}
        metrics = {"settling": 9.0 - 2.0 * k, "overshoot": 0.1 * k}
        made.append(
            {
                "style": name,
                "at": 50.0 * k,
                "gains": [{"parameter": "ATC_STR_RAT_P", "old": 0.2, "new": 0.3 + 0.1 * k}],
                "step": step,
                "margins": {"gain": 3.0, "phase": 0.9},
                "metrics": {"before": metrics, "after": metrics},
                "largest_output": 0.5,
            }
        )
    return json.dumps({"schema": 2, "styles": made})


PROOF = {
    **trial("02-step-before", 1.5),
    **trial("06-step-after", 0.3),
    "report.html": "<title>Report</title>",
    "model.json": "{}",
    "styles.json": styles(),
}
LOST = "Lost contact with ArduRover 4.6.0 on udpin:0.0.0.0:14550 (30 s). Check power and the radio."
NO_PORT = "cannot open /dev/ttyUSB0: no such file"
OPENED = {"event": "opened", "time": "2026-11-26T21:19:09+00:00", "schema": 1}
WAY_ON = (
    "these records of the run can be used again: step-before. To continue from there, change --max-speed and keep the "
    "other options: gcs-autotune tune heading --connect /dev/ttyUSB0 --resume runs/lake"
)
WORSE = "the measured comparison failed: tracking error 14 % higher"

STORIES: Mapping[str, Story] = {
    "": Story(ASKED, after=NEW),
    "connecting": Story([("say", "link: udpin:0.0.0.0:14550")], left=None, after=None),
    "asking": Story(
        [*ANNOUNCED, vitals("HOLD", armed=False), ("question", {"id": 1, "text": "Go ahead?"})], left=None, after=None
    ),
    "previewed": Story(
        [*ANNOUNCED, vitals("HOLD", armed=False), ("track", TRACK), ("question", {"id": 1, "text": "Go ahead?"})],
        left=None,
        after=None,
    ),
    "flying": Story(FLYING, journal="closed"),
    "stopping": Story(FLYING, stops=2, journal="closed"),
    "writing": Story(
        [
            *FLYING,
            ("proposal", PROPOSAL),
            ("question", {"id": 2, "text": "Write ATC_STR_RAT_P and test it?"}),
        ],
        journal="closed",
    ),
    "job": Story(
        [("steps", {"steps": STEPS}), *FLYING], journal="closed", files={"job.json": job("kept", "aborted", "open")}
    ),
    "kept": Story(FLYING, waits=False, ending="kept", flown=FLOWN, after=NEW, journal="closed", files=PROOF),
    "restored": Story(
        [*FLYING, ("proposal", PROPOSAL)], False, 1, 8, "", HOLD, "restored", FLOWN[:1], OLD, "closed", PROOF
    ),
    "aborted": Story(
        [*FLYING, ("say", WAY_ON)],
        False,
        1,
        5,
        "speed 3.1 m/s: more than the limit of 3 m/s (--max-speed)",
        journal="closed",
    ),
    "lost": Story(FLYING, False, 1, 3, LOST, None, after=None, journal="open"),
    "differs": Story(FLYING, False, 1, 9, "mode is MANUAL, not HOLD", NOT_HOLD, journal="open"),
    "unreachable": Story([("say", "link: /dev/ttyUSB0")], False, 1, 3, NO_PORT, None, after=None),
    "done": Story(FLYING, waits=False, journal="closed", files={"job.json": job("kept", "restored", "kept"), **PROOF}),
    "undo": Story(
        [
            ("say", "vehicle: ArduRover 4.6.0 (system 1, component 1)"),
            ("question", {"id": 1, "text": "Write ATC_STR_RAT_P 0.4 -> 0.2?"}),
        ]
    ),
}
"""Link of the form ``story:NAME`` -> what happens on it."""


def tell(key: str, value: object) -> None:
    sys.stdout.write(json.dumps({key: value}) + "\n")
    sys.stdout.flush()


def word(option: str) -> str:
    return next((word.partition("=")[2] for word in sys.argv if word.startswith(f"--{option}=")), "")


def wait_for_yes(stops: int) -> bool:
    """Wait for an answer, or for so many stops; return whether it is a yes."""
    for line in sys.stdin:
        answer = json.loads(line).get("answer")
        stops -= answer is None
        if answer or not stops:
            return bool(answer and answer["yes"])
    return False


def main() -> int:
    undoes = "restore" in sys.argv
    link = word("connect")
    story = STORIES["undo" if undoes else link.removeprefix("story:") if link.startswith("story:") else ""]
    if undoes:
        return undo(story)
    out = Path(word("out") or word("resume"))
    out.mkdir(parents=True, exist_ok=True)
    (out / "parameters_before.json").write_text(json.dumps(OLD))
    held = (out / "parameters_before.json").open("rb")  # for as long as it runs: whoever locks it knows when that ends
    if fcntl is not None:
        fcntl.flock(held, fcntl.LOCK_EX)
    for key, value in story.messages:
        tell(key, value)
        sys.stdout.write("this is no line of ours\n")
    went = wait_for_yes(story.stops) if story.waits else True
    if story.after is not None:
        (out / "parameters_after.json").write_text(json.dumps(story.after if went else OLD))
    return end(story, out, link, went=went)


def end(story: Story, out: Path, link: str, *, went: bool) -> int:
    """Write the files of the run, send the final state of the vehicle, and return the exit code."""
    files = dict(story.files)
    if story.journal is not None:
        events = [{**OPENED, "link": link}, *[{**OPENED, "event": "closed"}] * (story.journal == "closed")]
        files["journal.jsonl"] = "".join(json.dumps(event) + "\n" for event in events)
        files["parameters_before.param"] = "ATC_STR_RAT_P,0.2\n"
    if story.ending:
        summary = {"title": "tune heading", "axis": "heading", "ending": story.ending, "verdict_reasons": story.flown}
        files["summary.json"] = json.dumps({**summary, "reason": WORSE if story.code else ""})
    for name, text in files.items():
        (out / name).parent.mkdir(exist_ok=True)
        (out / name).write_text(text)
    if story.left is not None:
        tell("left", story.left)
    error = story.error if went else STOPPED
    sys.stderr.write(f"gcs-autotune: {error}\n" if error else "")
    return story.code if went else 130


def undo(story: Story) -> int:
    for key, value in story.messages:
        tell(key, value)
    if not wait_for_yes(story.stops):
        sys.stderr.write("gcs-autotune: nothing was written: the answer was no\n")
        return 130
    tell("say", "ATC_STR_RAT_P: 0.4 -> 0.2")
    tell("say", "1 parameter changed, verified by reading back")
    return 0


if __name__ == "__main__":
    sys.exit(main())
