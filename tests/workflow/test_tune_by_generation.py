"""``tune depth`` on firmware of another age: its own names and units at the edge, from journal to report."""

from __future__ import annotations

import pytest

from gcs_autotune.link import Journal
from gcs_autotune.mavlink import load_params

from .sitl_harness import SLOW_LOOP, SitlHarness

pytestmark = pytest.mark.slow

GAINS = ("PSC_D_POS_P", "PSC_D_VEL_P", "PSC_D_VEL_I", "PSC_D_ACC_P", "PSC_D_ACC_I", "PSC_D_ACC_FF")
INSIDE = ("PSC_POSZ_P", "PSC_VELZ_P", "PSC_VELZ_I", "PSC_ACCZ_P", "PSC_ACCZ_I", "PSC_ACCZ_FF")
SCALES = (1.0, 1.0, 1.0, 0.1, 0.1, 0.1)


@pytest.fixture(scope="module")
def tuned(tmp_path_factory):
    harness = SitlHarness(tmp_path_factory.mktemp("tuned47"), "videoray", names="4.7", **SLOW_LOOP)
    return harness, harness.tune(axis="depth")


def test_a_vehicle_with_new_names_is_tuned_in_its_own_units(tuned):
    harness, story = tuned
    assert story.ending == "kept"
    assert set(story.proposal.new) <= set(GAINS)
    inside = {own: (name, scale) for own, name, scale in zip(GAINS, INSIDE, SCALES, strict=True)}
    for own, value in story.proposal.new.items():
        name, scale = inside[own]
        assert harness.vehicle.dialect[own] == pytest.approx(value, rel=1e-6)
        assert harness.vehicle.parameters[name] == pytest.approx(value / scale, rel=1e-6)


def test_files_journal_and_report_use_the_vehicles_parameter_names(tuned):
    harness, story = tuned
    before = load_params(harness.directory / "parameters_before.param")
    assert before["PSC_D_ACC_P"] == pytest.approx(0.05)
    assert before["PILOT_SPD_UP"] == pytest.approx(2.0)
    journal = Journal.read(harness.directory / "journal.jsonl")
    assert journal.closed
    page = (harness.directory / "report.html").read_text()
    texts = (*harness.said, page, (harness.directory / "gains.json").read_text(), *story.proposal.notes)
    assert not [text for text in texts for old in ("PSC_ACCZ", "PSC_POSZ", "PSC_VELZ", "PILOT_SPEED") if old in text]
