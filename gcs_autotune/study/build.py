"""Which code runs here: version, sources and compiled kernels. Only equal code gives equal rows."""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from gcs_autotune import __version__

__all__ = ["Build", "build_of", "difference_from", "importing_from"]

PACKAGES = ("gcs_autotune", "gcs_autotune_files", "sitl")
_COMPILED = ("numba", "llvmlite", "numpy", "scipy")
"""Packages whose versions change compiled code or its results."""


@dataclass(frozen=True, slots=True)
class Build:
    """The code of a process.

    ``version``: of this program, with the first digits of the hash of its sources.
    ``kernels``: what its compiled functions depend on: Python, compilers, processor.
    ``function``: hash of the source of a study's own function and its package; empty without one.
    """

    version: str
    kernels: str
    function: str = ""

    def __str__(self) -> str:
        own = f", function {self.function}" if self.function else ""
        return f"gcs_autotune {self.version} ({self.kernels}{own})"


def build_of(do: str = "", home: Path | None = None) -> Build:
    """Return the code of this process. *do*, *home*: the function of a study and the folder of its file, if any."""
    module, colon, _ = do.partition(":")
    return Build(*_own(), _hash_of_module(module, str(home or "")) if colon else "")


def difference_from(expected: Build, do: str, home: Path) -> str:
    """Return how this process's code differs from *expected*, with both versions; empty if it does not."""
    own = build_of(do, home)
    return "" if own == expected else f"{own}, but the study needs {expected}"


@contextlib.contextmanager
def importing_from(home: str) -> Iterator[None]:
    """Search modules in the folder *home* first, as Python does for a program there. Afterwards it is searched last."""
    if not (home and Path(home).is_dir()):
        yield
        return
    sys.path.insert(0, home)
    try:
        yield
    finally:
        sys.path.remove(home)
        if home not in sys.path:
            sys.path.append(home)


@cache
def _own() -> tuple[str, str]:
    digest = hashlib.sha256()
    for package in PACKAGES:
        spec = importlib.util.find_spec(package)
        for folder in [] if spec is None else spec.submodule_search_locations or []:
            for path in sorted(Path(folder).rglob("*")):
                if path.suffix in (".py", ".toml"):
                    digest.update(f"{package}/{path.relative_to(folder).as_posix()}".encode() + path.read_bytes())
    python = ".".join(map(str, sys.version_info[:2]))
    kernels = [f"Python {python}", *(f"{name} {version(name)}" for name in _COMPILED), f"CPU {_processor()}"]
    return f"{__version__}+{digest.hexdigest()[:8]}", ", ".join(kernels)


def _processor() -> str:
    """Return the processor that numba compiles for; ``NUMBA_CPU_NAME=generic`` on all workers makes it equal."""
    named = os.environ.get("NUMBA_CPU_NAME", "")
    if named:
        return named
    llvm: Any = importlib.import_module("llvmlite.binding")
    return str(llvm.get_host_cpu_name())


@cache
def _hash_of_module(module: str, home: str) -> str:
    """Return the hash of a module's source, or of its whole package if it is in one; empty if it is not found.

    The module itself is not imported for it.
    """
    try:
        with importing_from(home):
            spec = importlib.util.find_spec(module)
    except (ImportError, ValueError):
        return ""
    if spec is None or not spec.origin or not Path(spec.origin).is_file():
        return ""
    files, top = [Path(spec.origin)], module.partition(".")[0]
    if top != module and (package := importlib.util.find_spec(top)) is not None:
        files = [p for folder in package.submodule_search_locations or [] for p in sorted(Path(folder).rglob("*.py"))]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:8]
