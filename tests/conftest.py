"""Shared fixtures, and the distribution of tests among processes."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any
from uuid import uuid4

import hypothesis
import pytest

from gcs_autotune import executor

# A busy machine is no failure, and every run tries the same examples.
hypothesis.settings.register_profile("any machine", deadline=None, derandomize=True)
hypothesis.settings.load_profile("any machine")

ROOT = Path(__file__).parents[1]

WARM_UP = (
    "-c",
    "from gcs_autotune.workflow.jit_warmup import warm_up; warm_up(['surge', 'yaw'], ['rover-heading'])",
)
"""Compile what most tests need."""
FILTERS = (
    "-c",
    """
from gcs_autotune.identify import fit
from gcs_autotune.workflow.jit_warmup import _swing
fit([_swing(["yaw"])], "linear", "ekf", dof="yaw")
""",
)
"""Compile the filters, and what uses exact transitions. Before any test: while the first of them ran, two processes
compiled the same once more each, for half a minute of processor."""
HULL = ("-c", "from sitl import load_vehicle; load_vehicle('charlie').make_plant()")
"""Compile the hull of the simulator, for which its processes would else time out on a busy machine."""
OVER_REAL_LINKS = ("tests/closed_loop/test_real_links.py", "tests/closed_loop/test_mavproxy.py")
"""Files whose tests wait for a vehicle with its own clock."""
REWRITE = ("-m", "pytest", "-n0", "--collect-only", "--quiet")
"""Rewrites the assertions of all tests, which takes longer than to collect them, and every process would do."""


def pytest_configure(config: pytest.Config) -> None:
    """Compile once what all processes would compile, where nothing is compiled yet; no settings of the user's count."""
    os.environ["GCS_AUTOTUNE_CONFIG"] = "none"
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is imported: see gcs_autotune.cli.main
    several = getattr(config.option, "numprocesses", None) and not hasattr(config, "workerinput")
    if several and next((ROOT / "sitl").rglob("*.nbi"), None) is None:
        assert _python(*HULL).wait() == 0
    if several and next((ROOT / "gcs_autotune").rglob("*.nbi"), None) is None:  # numba's, next to the source
        beside = [] if sys.dont_write_bytecode else [_python(*REWRITE)]
        for compiling in (WARM_UP, FILTERS):  # one after the other: they share much
            assert _python(*compiling).wait() == 0
        for process in beside:
            process.wait()  # collection errors are reported by the workers


def module_of_the_docs(name: str) -> ModuleType:
    """Return a program of ``docs`` as a module."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _python(*arguments: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, *arguments], cwd=ROOT, stdout=subprocess.DEVNULL)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """One more than there are processors where browsers and links keep real time: they leave theirs to others."""
    all_compute = "not slow" in config.option.markexpr
    return (os.cpu_count() or 1) + (0 if all_compute else 1)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Keep together the tests of a file that share something: a fixture, a compiled function, an open page.

    All tests in real time, in a browser or over a real link, are one scope: they wait more than they compute. One
    waiting process leaves the processors to the others; two would leave one processor idle.
    """
    if config.getvalue("dist") != "load":
        return None
    from xdist.scheduler import LoadScopeScheduling

    once = re.compile(r'scope="module"|^@(njit|cache)\b', re.MULTILINE)
    scopes: dict[str, str] = {}
    for path in ROOT.glob("tests/**/*.py"):
        file, text = path.relative_to(ROOT).as_posix(), path.read_text()
        if "pytest.mark.browser" in text or file in OVER_REAL_LINKS:
            scopes[file] = "real time"
        elif once.search(text):
            scopes[file] = file

    class Sharing(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return scopes.get(nodeid.partition("::")[0], nodeid)

    return Sharing(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Whatever needs ArduPilot is slow."""
    for item in items:
        if item.get_closest_marker("ardupilot"):
            item.add_marker(pytest.mark.slow)


_FEW = {"EVALUATIONS": 8, "EVALUATIONS_OF_FIRST": 8, "SCATTER": 3, "ROUNDS": 1, "DESCENTS": 1}


@contextmanager
def in_few_evaluations() -> Iterator[None]:
    """Refine in a few evaluations: what holds of a proposal holds of any; ``test_refinement`` asks for the best."""
    with pytest.MonkeyPatch.context() as patch:
        for name, number in _FEW.items():
            patch.setattr(f"gcs_autotune.design.refinement.{name}", number)
        yield


def serve_in_few_evaluations(pipe: Any) -> None:
    """Serve as a kept process of the executor does, in few evaluations."""
    with in_few_evaluations():
        executor._serve_apart(pipe)


@pytest.fixture(scope="session", autouse=True)
def _shared_state_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Programs that several tests share record open runs outside the home folder, where a killed test would leave
    them.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.getbasetemp() / "state" / "shared"))
        yield


@pytest.fixture(autouse=True)
def _own_state_folder(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each test and the programs it starts record open runs in a separate folder."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path_factory.getbasetemp() / "state" / uuid4().hex))


@pytest.fixture(scope="module")
def briefly() -> Iterator[None]:
    """Do as :func:`in_few_evaluations` for all tests of a file."""
    with in_few_evaluations():
        yield


@pytest.fixture(scope="session")
def published() -> dict[str, Any]:
    """The published tables, kept next to the repository."""
    path = ROOT / ".." / "shared" / "data" / "published_tables.json"
    if not path.exists():
        pytest.skip("published_tables.json is not beside the repository (../shared/data)")
    return dict(json.loads(path.read_text(encoding="utf-8")))


CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
WCAG_AA = {"runOnly": {"type": "tag", "values": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa"]}}


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium without a window, driven by Playwright; while it is there no other event loop can run in this thread."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: pip install '.[test]'")
    if CHROMIUM is None:
        pytest.skip("there is no Chromium on this machine: apt install chromium")
    with playwright.sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield chromium
        chromium.close()


@pytest.fixture(scope="session")
def barriers() -> Callable[[Any], list[tuple[str, str]]]:
    """What of a page in the browser keeps to WCAG 2.1 AA not, by axe-core: its rule and where on the page."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="no axe-core: pip install '.[test]'")

    def found(page: Any) -> list[tuple[str, str]]:
        reported = axe.Axe().run(page, options=WCAG_AA).response
        assert len(reported["passes"]) > 10
        return [(rule["id"], str(node["target"])) for rule in reported["violations"] for node in rule["nodes"]]

    return found
