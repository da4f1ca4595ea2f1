"""Tuning from a model file: no experiments, the effects in the design, still proved on the water."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gcs_autotune.effects import EffectInstance, ExtendedModel
from gcs_autotune.errors import OperatorStopped, UsageError
from gcs_autotune.identify import load_model
from gcs_autotune.identify.axis.form import as_extended
from gcs_autotune.models import SingleDof
from gcs_autotune.workflow import Unattended
from sitl.effects.table import make_effect

from .sitl_harness import SitlHarness

pytestmark = pytest.mark.slow

ALPHA, BETA = 16.36, 4.912
"""The simulated boat's own yaw, input as a fraction of full rudder."""
DEAD = 0.06


def model_file(folder: Path, *effects: EffectInstance, unit: str = "1", alpha: float = ALPHA) -> Path:
    """Write a model file as a diagnosis does."""
    plain = as_extended(SingleDof("yaw", unit, alpha, BETA))
    path = folder / "model.json"
    path.write_text(json.dumps(ExtendedModel(plain.base, effects).to_dict()), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def tuned(tmp_path_factory):
    folder = tmp_path_factory.mktemp("given")
    harness = SitlHarness(folder, effects=[make_effect("dead-zone", "N", {"width": DEAD})])
    given = load_model(model_file(folder, EffectInstance("dead-zone", "N", {"width": DEAD})))
    return harness, harness.tune(given=given)


def test_gains_designed_from_a_file_prove_better_on_the_water(tuned):
    harness, story = tuned
    assert story.ending == "kept"
    assert story.metrics_after.itae < 0.95 * story.metrics_before.itae
    for name, value in story.proposal.new.items():
        assert harness.vehicle.parameters.values[name] == pytest.approx(value, rel=1e-6)


def test_no_experiment_is_flown_or_announced(tuned):
    harness, story = tuned
    assert story.relays == () and story.fit is None
    assert not any("oscillations about" in text or "self-oscillation" in text for text in harness.said)


def test_the_model_is_compared_with_the_step_flown_first(tuned):
    harness, _ = tuned
    announced = next(text for text in harness.said if "explains" in text)
    assert float(announced.split("explains ")[1].split(" %")[0]) > 85.0
    assert "the model is of this craft" not in announced


def test_the_handling_of_the_effect_is_reported_and_recorded(tuned):
    harness, _ = tuned
    assert any(text.startswith("dead zone (N):") and "MOT_THR_MIN" in text for text in harness.said)
    gains = json.loads((harness.directory / "gains.json").read_text())
    assert [e["slug"] for e in gains["effects"]] == ["dead-zone"]
    assert set(gains["left_alone"]) == {"before", "after"}
    model = json.loads((harness.directory / "model.json").read_text())
    assert model["effects"][0]["values"] == {"width": DEAD}


def test_a_model_of_another_craft_is_detected(tmp_path):
    harness = SitlHarness(tmp_path)
    story = harness.tune(given=load_model(model_file(tmp_path, alpha=0.05 * ALPHA)), dry_run=True)
    assert any("the model is of this craft" in text for text in harness.said), harness.said
    assert story.ending in ("dry-run", "unchanged")


def test_a_model_in_newton_metres_needs_the_full_scale_before_anything_moves(tmp_path):
    harness = SitlHarness(tmp_path)
    with pytest.raises(UsageError, match="--full-scale"):
        harness.tune(given=load_model(model_file(tmp_path, unit="N m")))
    assert not any("step with present gains" in text for text in harness.said)


def test_a_stop_during_the_design_prevents_the_automatic_approval(tmp_path) -> None:
    harness, given = SitlHarness(tmp_path), load_model(model_file(tmp_path))

    class Stops(Unattended):
        def stop_requested(self) -> bool:
            return any(text.startswith("predicted") for text in harness.said)

    with pytest.raises(OperatorStopped, match="stopped by the operator"):
        harness.tune(Stops(), agreed=True, given=given)
    assert not any(text.startswith("Write ") for text in harness.said)
    harness.assert_as_found()
