"""`tune all`: the order of the table, one consent, one report, resumed and undone as a whole."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from gcs_autotune.errors import GuardTripped, NotInformative, OperatorStopped, PreconditionFailed, UsageError
from gcs_autotune.link import Journal, MemoryLink
from gcs_autotune.observer import SilentObserver
from gcs_autotune.report import JobStory
from gcs_autotune.workflow import (
    Connection,
    TuneSettings,
    Unattended,
    restore_parameters,
    restore_run,
    tune_all,
)
from gcs_autotune.workflow.tune import TuneJob, job_of

from .sitl_harness import SLOW_LOOP, Answers, Ear, SitlHarness

Ending = str | BaseException
ROV = "bluerov2"


class Scripted:
    """Takes the place of the tunes: each is declared as it is, and ends as scripted without flying."""

    def __init__(self, endings: Mapping[str, Ending]) -> None:
        self.endings = dict(endings)
        self.flown: list[str] = []
        self.resumed: dict[str, Path | None] = {}

    def of(self, name: str) -> TuneJob:
        return TuneJob(lambda settings, *more: self._run(name, settings, more[-1]), partial(self._declare, name))

    def _declare(self, name: str, settings: Any, visit: Any) -> Any:
        self.resumed[name] = settings.resume
        return job_of(name).declare(replace(settings, resume=None), visit)

    def _run(self, name: str, settings: TuneSettings, when: str) -> Any:
        assert settings.agreed
        self.flown.append(name)
        ending = self.endings.get(name, "kept")
        settings.directory.mkdir(parents=True)
        reported = {
            "ending": ending if isinstance(ending, str) else "aborted",
            "reason": "scripted",
            "when": when,
            "gains": {"GAIN_OF_" + name.upper(): [0.2, 0.8]},
            "metrics": {
                "before": {"itae": 4.0, "overshoot": 0.3, "settling": 9.0},
                "after": {"itae": 1.0, "overshoot": 0.1, "settling": None},
            },
            "track": None,
        }
        (settings.directory / "summary.json").write_text(json.dumps(reported))
        (settings.directory / "parameters_after.json").write_text("{}")
        (settings.directory / "setting_out.json").write_text("{}")
        if isinstance(ending, BaseException):
            raise ending


class Bench:
    """A simulated vehicle whose loops are tuned one after the other."""

    def __init__(self, tmp_path: Path, name: str, **options: Any) -> None:
        self.harness = SitlHarness(tmp_path, name, **options)
        self.link = MemoryLink(self.harness.peer)
        self.link.is_simulated = True
        self.job = tmp_path / "job"
        self.said: list[str] = []
        self.moments = (f"2026-11-20T20:{minute:02d}:00" for minute in range(60))

    def tune(self, operator: Any = None, **changes: Any) -> JobStory:
        settings = TuneSettings(Connection("memory", opened=self.link), self.job, axis="heading", **changes)
        return tune_all(settings, operator or Unattended(), Ear(self.said), lambda: next(self.moments))

    @property
    def summary(self) -> Any:
        return json.loads((self.job / "summary.json").read_text())

    @property
    def endings(self) -> dict[str, str]:
        return {step["name"]: step["ending"] for step in self.summary["steps"]}


@pytest.fixture
def scripted(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Scripted]:
    def script(**endings: Ending) -> Scripted:
        script = Scripted(endings)
        monkeypatch.setattr(import_module("gcs_autotune.workflow.tune_all"), "job_of", script.of)
        return script

    return script


def test_an_rov_is_tuned_in_table_order_after_one_announcement(tmp_path, scripted) -> None:
    bench, script = Bench(tmp_path, ROV), scripted(depth="restored")
    story = bench.tune()
    assert script.flown == ["heading", "depth"]
    assert bench.endings == {"heading": "kept", "depth": "restored"}
    messages = [text for text in bench.said if text.startswith("will ")]
    assert any("in this order: heading, depth" in text for text in messages)
    assert any("take about" in text and "heading" in text and "depth" in text for text in messages)
    assert any("go deeper by as much as the vehicle sinks" in text for text in messages)
    assert sum("Go ahead" in text for text in bench.said) == 1
    assert story.ending == "kept" and not story.resume
    page = (bench.job / "report.html").read_text()
    assert "2 loops: 1 kept, 1 restored." in page
    reported = "Heading: the new gains are kept, tracking error 75\u00a0% lower (measured). GAIN_OF_HEADING "
    assert reported in page.replace("&nbsp;", "\u00a0")
    assert "GAIN_OF_HEADING" in page and "params restore" in page
    assert (bench.job / "parameters_before.param").read_text().count("PSC_") >= 4
    assert not bench.link.stays_open


def test_each_step_is_dated_by_its_own_start(tmp_path, scripted) -> None:
    bench, _ = Bench(tmp_path, ROV), scripted(depth="restored")
    bench.tune()
    steps = [json.loads(path.read_text())["when"] for path in sorted(bench.job.glob("*/summary.json"))]
    assert [bench.summary["when"], *steps] == [f"2026-11-20T20:0{minute}:00" for minute in range(3)]


def test_roll_pitch_and_position_are_tuned_when_requested(tmp_path, scripted) -> None:
    bench, script = (
        Bench(tmp_path, "bluerov2-6dof", **SLOW_LOOP),
        scripted(heading="restored", depth="restored", position="restored"),
    )
    bench.tune(loops=("heading", "depth", "roll", "pitch", "position"))
    assert script.flown == ["heading", "depth", "roll", "pitch", "position"]
    assert list(bench.endings) == script.flown
    assert any("move for pitch: a small pulse in each direction" in text for text in bench.said)


def test_position_is_omitted_without_a_position_estimate(tmp_path, scripted) -> None:
    def lost(_: float, message: Any) -> Iterable[Any]:
        if message.get_type() == "EKF_STATUS_REPORT":
            message.flags = 0
        return (message,)

    bench, script = Bench(tmp_path, "bluerov2-6dof", meddling=lost, **SLOW_LOOP), scripted()
    bench.tune(loops=("heading", "depth", "roll", "pitch", "position"))
    assert script.flown == ["heading", "depth", "roll", "pitch"]
    (reported,) = (text for text in bench.said if text.startswith("will not tune position"))
    assert "no position estimate for 5 s" in reported


def test_nothing_is_flown_when_the_answer_is_no(tmp_path, scripted) -> None:
    bench, script, operator = Bench(tmp_path, ROV), scripted(), Answers(False)
    bench.link.is_simulated = False
    with pytest.raises(OperatorStopped, match="the answer was no"):
        bench.tune(operator)
    assert script.flown == [] and len(operator.questions) == 1
    assert not bench.harness.vehicle.autopilot.armed


@pytest.mark.slow
def test_a_failed_loop_skips_only_the_loops_that_depend_on_it(tmp_path, scripted) -> None:
    bench, script = Bench(tmp_path, "blueboat"), scripted(speed=NotInformative("no motion"))
    story = bench.tune()
    assert script.flown == ["speed", "heading"]
    assert bench.endings == {
        "speed": "aborted",
        "heading": "kept",
        "line": "skipped",
        "recheck speed": "skipped",
        "recheck heading": "skipped",
    }
    announced = " ".join(bench.said)
    assert (
        "move for recheck speed and recheck heading: relays on the set-point, and the tune's step, up to" in announced
    )
    reasons = {step.name: step.reason for step in story.steps}
    assert reasons["speed"] == "no motion" and reasons["line"] == "because it stands on speed"
    assert reasons["recheck speed"] == "because speed has no new gains"
    assert "--resume" in story.resume


def test_a_tripped_limit_ends_the_job_and_resuming_continues_at_the_next_step(tmp_path, scripted) -> None:
    bench = Bench(tmp_path, ROV)
    scripted(depth=GuardTripped("too deep", guard="depth"))
    with pytest.raises(GuardTripped):
        bench.tune()
    assert bench.endings == {"heading": "kept", "depth": "aborted"}
    assert any("tune all --connect memory --resume" in text for text in bench.said)
    script = scripted()
    story = bench.tune(resume=bench.job)
    assert script.flown == ["depth"]
    assert script.resumed == {"depth": bench.job / "02-depth"}, "what it has is not announced again"
    assert [step.ending for step in story.steps] == ["kept", "kept"]
    assert [step.directory for step in story.steps] == ["01-heading", "04-depth"]


def test_a_job_can_be_resumed_only_with_its_own_settings(tmp_path, scripted) -> None:
    bench = Bench(tmp_path, ROV)
    scripted(depth=GuardTripped("too deep", guard="depth"))
    with pytest.raises(GuardTripped):
        bench.tune()
    with pytest.raises(UsageError, match="style normal, not gentle"):
        bench.tune(resume=bench.job, style="gentle")
    with pytest.raises(UsageError, match=r"contains no job\.json"):
        bench.tune(resume=tmp_path)
    opened = {"event": "opened", "schema": 1, "vehicle": {}, "link": "memory", "mode": "MANUAL", "armed": False}
    (bench.job / "02-depth" / "journal.jsonl").write_text(json.dumps({**opened, "fingerprint": {}}) + "\n")
    with pytest.raises(PreconditionFailed, match="gcs-autotune restore"):
        bench.tune(resume=bench.job)


@pytest.mark.slow
def test_a_job_is_stopped_resumed_and_restored_as_a_whole(tmp_path, plainly) -> None:
    bench = Bench(tmp_path, ROV)
    before = dict(bench.harness.vehicle.parameters.values)

    class Stops:
        """Presses Ctrl-C during the step with the new gains of the depth."""

        def stop_requested(self) -> bool:
            begun = next((k for k, text in enumerate(bench.said) if "of 2: depth" in text), len(bench.said))
            return any("step with new gains" in text for text in bench.said[begun:])

        def ask(self, question: str, while_waiting: Callable[[], object]) -> bool:
            return True

    with pytest.raises(OperatorStopped):
        bench.tune(Stops())
    autopilot = bench.harness.vehicle.autopilot
    assert not autopilot.armed and all(pwm in (0, 1500) for pwm in autopilot.pwm)
    now = bench.harness.vehicle.parameters.values
    assert {name.partition("_YAW_")[0] for name, value in now.items() if value != before[name]} <= {
        "ATC_RAT",
        "ATC_ANG",
    }
    assert sum("--resume" in text for text in bench.said) == 1
    story = bench.tune(resume=bench.job)
    assert "using from" in " ".join(bench.said)
    assert bench.endings == {"heading": "kept", "depth": "kept"}
    announced, took = story.seconds
    assert took <= 1.2 * announced
    assert all(Journal.read(path).is_settled for path in bench.job.glob("*/journal.jsonl"))
    link = Connection("memory", opened=bench.link)
    bench.link.stays_open = True
    assert restore_run(link, bench.job, Unattended(), SilentObserver()) == {}
    restore_parameters(link, bench.job / "parameters_before.param", Unattended(), SilentObserver())
    assert dict(bench.harness.vehicle.parameters.values) == before
