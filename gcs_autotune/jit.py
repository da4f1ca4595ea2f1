"""Options of numba for all compiled functions, which fly, simulate and measure.

Functions compiled here allocate no memory, so reference counting is off. Division by zero is not checked: it gives
infinity, and the caller then stops the simulation. Results are identical with both options, in half of the time or
less. Code that allocates memory uses numba's own ``njit``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

__all__ = ["called", "entry", "entry_without_lock", "inlined", "pasted"]

_Function = TypeVar("_Function", bound=Callable[..., Any])

_LEAN: dict[str, Any] = {"_nrt": False, "no_cfunc_wrapper": True, "error_model": "numpy"}

entry: Callable[[_Function], _Function] = njit(**{**_LEAN, "cache": True})
"""Compile a function that is called from Python, and cache it on disk."""
entry_without_lock: Callable[[_Function], _Function] = njit(**{**_LEAN, "cache": True, "nogil": True})
"""Compile like :data:`entry` but release Python's interpreter lock, so that other threads run during a long call."""
called: Callable[[_Function], _Function] = njit(**{**_LEAN, "cache": True, "no_cpython_wrapper": True})
"""Compile a function that only compiled functions call. Omitting its Python wrapper halves the compiled code."""
inlined: Callable[[_Function], _Function] = njit(**{**_LEAN, "forceinline": True, "no_cpython_wrapper": True})
"""Compile like :data:`called`, and copy the compiled code into its callers.

For short functions called at every step.
"""
pasted: Callable[[_Function], _Function] = njit(**{**_LEAN, "inline": "always"})
"""Copy a function into its caller before types are inferred. For a short function with one caller.

With a long function or several callers, repeated type inference takes longer than a separate compilation.
"""
