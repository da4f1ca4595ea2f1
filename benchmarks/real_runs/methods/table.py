"""The methods by name."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module

from benchmarks.real_runs.methods import Train

__all__ = ["METHODS", "PEERS", "trainer"]

METHODS: Mapping[str, str] = {
    "ours": "ours",
    "scipy by hand": "plain_scipy",
    "sysidentpy": "sysidentpy_frols",
    "pysindy": "pysindy_stlsq",
    "jax-sysid": "jax_sysid_model",
    "nfoursid": "nfoursid_n4sid",
    "sippy": "sippy_n4sid",
}
"""Name -> file in this package."""

PEERS = tuple(list(METHODS)[2:])


def trainer(name: str) -> Train:
    """Return a method's ``train``; ImportError when its package is not installed."""
    found: Train = import_module(f"benchmarks.real_runs.methods.{METHODS[name]}").train
    return found
