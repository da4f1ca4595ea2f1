"""Run a complete diagnosis of a simulation: read the runs, search for causes, write the verdict and the files."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from gcs_autotune import __version__
from gcs_autotune.diagnose import Diagnosis, diagnose
from gcs_autotune.documents import MODEL, model_file
from gcs_autotune.effects import EFFECTS
from gcs_autotune.errors import AutotuneError, UsageError
from gcs_autotune.identify import load_model
from gcs_autotune.kept_results import KeptResults, fingerprint, keeping
from gcs_autotune.plain_json import json_text
from gcs_autotune.registry import lookup
from gcs_autotune.report import diagnosis_document, save_page, to_json
from gcs_autotune.trial import Trial

__all__ = ["DiagnosisSettings", "run_diagnosis", "write_diagnosis"]

KEPT_FILE = "search.jsonl"
"""Name of the file that stores the intermediate results of a search, in the folder of its page."""


@dataclass(frozen=True, slots=True)
class DiagnosisSettings:
    """Settings of ``diagnose``; the names are those of :func:`gcs_autotune.diagnose.diagnose`.

    ``model``: a model file.
    ``effects``: slugs to try; None: all.
    ``without``: slugs to leave out.
    ``jobs``: number of processes.
    ``max_seconds``: the search stops after this time.
    ``keep``: the folder that stores results until the search ends.
    ``resume``: the folder to continue from.
    """

    dof: str | None = None
    use: tuple[str, ...] | None = None
    model: Path | None = None
    simulations: tuple[Trial, ...] = ()
    effects: tuple[str, ...] | None = None
    without: tuple[str, ...] = ()
    jobs: int = 1
    horizon: float | None = None
    max_seconds: float = math.inf
    keep: Path | None = None
    resume: bool = False

    def slugs(self) -> tuple[str, ...] | None:
        """Return the slugs of the effects to try; None for all.

        Raises
        ------
        UnknownName
            A slug belongs to no effect. UsageError: no effect is left to try.
        """
        for slug in (*(self.effects or ()), *self.without):
            lookup(EFFECTS, slug, "effect")
        if self.effects is None and not self.without:
            return None
        left = tuple(s for s in (self.effects if self.effects is not None else EFFECTS) if s not in self.without)
        if not left:
            raise UsageError(
                "--effects and --without leave no effect to try. See `gcs-autotune diagnose --list-effects`"
            )
        return left


def run_diagnosis(
    runs: Sequence[Trial],
    unseen: Sequence[Trial],
    settings: DiagnosisSettings,
    watch: Callable[[str, int, int], None] | None = None,
) -> Diagnosis:
    """Diagnose *runs* and measure the improvement on the *unseen* runs; without these, on sections of *runs* left out
    in turn.

    *watch* receives the stage, how much of it is done, and its total.

    Raises
    ------
    AutotuneError
        The runs, the model file or the settings cannot be used; the message states the reason and what to try. It is
        also raised
            if the folder to resume from contains no search, or a search with other runs or settings.
    """
    kept = None
    if settings.keep is not None:
        model = None if settings.model is None else model_file(settings.model).read_bytes()
        asked = replace(settings, model=None, jobs=1, max_seconds=math.inf, keep=None, resume=False)
        path = settings.keep / KEPT_FILE
        if settings.resume and not path.exists():
            raise UsageError(f"{settings.keep} contains no stopped search to resume. Check the folder")
        if not settings.resume:
            path.unlink(missing_ok=True)
        kept = KeptResults(path, fingerprint(__version__, list(runs), list(unseen), asked, model))
    is_new = settings.keep is not None and not settings.keep.exists()
    try:
        with keeping(kept):
            told = _diagnosed(runs, unseen, settings, watch)
    except AutotuneError:  # refused: there is nothing to go on with
        if kept is not None:
            _forget(kept, is_new=is_new)
        raise
    if kept is not None and told.verdict == "unfinished":
        kept.begin()
    elif kept is not None:
        kept.remove()
    return told


def _forget(kept: KeptResults, *, is_new: bool) -> None:
    """Delete the stored results. Delete their folder too if *is_new* and it is empty."""
    kept.remove()
    if is_new:
        with suppress(OSError):
            kept.path.parent.rmdir()


def _diagnosed(
    runs: Sequence[Trial],
    unseen: Sequence[Trial],
    settings: DiagnosisSettings,
    watch: Callable[[str, int, int], None] | None,
) -> Diagnosis:
    return diagnose(
        runs,
        unseen=unseen,
        dof=settings.dof,
        use=settings.use,
        model=None if settings.model is None else load_model(settings.model),
        simulations=settings.simulations,
        effects=settings.slugs(),
        progress=watch,
        jobs=settings.jobs,
        horizon=settings.horizon,
        max_seconds=settings.max_seconds,
    )


def write_diagnosis(told: Diagnosis, directory: Path, when: str, runs: Sequence[Trial] = ()) -> Path:
    """Write ``report.html``, ``diagnosis.json`` and ``model.json`` (the extended model); return the path of the
    page.

    *runs*: the diagnosed runs, whose inputs and tracks the page plots. A stopped search has no model.
    """
    directory.mkdir(parents=True, exist_ok=True)
    title = f"Diagnosis of {', '.join(dict.fromkeys(told.used))}"
    document = diagnosis_document(told, title, when, str(directory), runs)
    (directory / "diagnosis.json").write_text(json_text(to_json(document)), encoding="utf-8")
    if told.verdict == "unfinished":
        (directory / MODEL).unlink(missing_ok=True)
    else:
        (directory / MODEL).write_text(json_text(told.extended_model.to_dict()), encoding="utf-8")
    return save_page(directory, document)
