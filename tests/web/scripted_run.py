"""Stands in for a run of our command line: says what a tune would, asks, and heeds STOP. Flies nothing."""

from __future__ import annotations

import json
import sys
from pathlib import Path

try:
    import fcntl
except ImportError:  # no POSIX
    fcntl = None  # type: ignore[assignment]

OUT = Path(next(word for word in sys.argv if word.startswith("--out=")).removeprefix("--out="))
ROW = [1.0, 0.1, 0.2, 0.3, 0.01, 1.0, 2.0, 0.1]
PROGRESS = {"stage": "first self-oscillation", "signal": "psi", "step": 3, "steps": 8, "elapsed": 60.0, "left": 120.0}
PROPOSAL = {"values": [{"parameter": "ATC_STR_RAT_P", "old": 0.2, "new": 0.4, "reason": "quicker <b>turns</b>"}]}

STEPS = [
    {"name": "speed", "state": "kept", "reason": "better", "seconds": 100.0},
    {"name": "heading", "state": "flying", "reason": "", "seconds": 200.0},
    {"name": "line", "state": "open", "reason": "", "seconds": 300.0},
]


def tell(key: str, value: object) -> None:
    sys.stdout.write(json.dumps({key: value}) + "\n")
    sys.stdout.flush()


def main() -> int:
    OUT.mkdir(parents=True)
    parameters = {"ATC_STR_RAT_P": 0.2}
    (OUT / "parameters_before.json").write_text(json.dumps(parameters))
    held = (OUT / "parameters_before.json").open("rb")  # for as long as it runs: whoever locks it knows when that ends
    if fcntl is not None:
        fcntl.flock(held, fcntl.LOCK_EX)
    arms = {"text": "arm the vehicle, and disarm it at the end", "row": "Arms", "brief": "yes, and disarms at the end"}
    tell("intentions", {"each": [arms], "texts": [arms["text"]]})
    tell("steps", {"steps": STEPS})
    tell("say", "will arm the vehicle, and disarm it at the end")
    tell("words", {"severity": 4, "text": "<img src=x onerror=alert(1)>\x1b[2J"})
    tell("samples", {"stage": "first self-oscillation", "manoeuvre": "relay", "signal": "psi", "rows": [ROW] * 3})
    tell("now", PROGRESS)
    sys.stdout.write("this is no line of ours\n")
    tell("proposal", {**PROPOSAL, "cost_before": 10.0, "cost_after": 2.0, "cost_worst": 3.0})
    tell("question", {"id": 1, "text": "Go ahead?"})
    code = 130
    for line in sys.stdin:
        told = json.loads(line)
        if told.get("answer", {}).get("yes"):
            parameters["ATC_STR_RAT_P"] = 0.4
            code = 0
        break
    (OUT / "parameters_after.json").write_text(json.dumps(parameters))
    tell("left", {"mode": "HOLD", "armed": False, "differs": {}})
    if code:
        sys.stderr.write("gcs-autotune: stopped by the operator\n")
    return code


if __name__ == "__main__":
    sys.exit(main())
