"""How the loops that fly, simulate and measure are compiled: the one place for numba's options.

What is compiled here allocates nothing, so references are not counted. No division is asked whether it is one by zero:
that gives infinity, and the caller gives the motion up. Both give the same bits, and half of the time or less. Code
that allocates uses numba's own ``njit``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

__all__ = ["called", "entry", "entry_without_lock", "inlined", "pasted"]

_Function = TypeVar("_Function", bound=Callable[..., Any])

_LEAN: dict[str, Any] = {"_nrt": False, "no_cfunc_wrapper": True, "error_model": "numpy"}

entry: Callable[[_Function], _Function] = njit(**{**_LEAN, "cache": True})
"""Compile a function that Python calls, and cache it on disk."""
entry_without_lock: Callable[[_Function], _Function] = njit(**{**_LEAN, "cache": True, "nogil": True})
"""Compile as :data:`entry`, without the lock of the interpreter. Other Python threads run during a long call."""
called: Callable[[_Function], _Function] = njit(**{**_LEAN, "cache": True, "no_cpython_wrapper": True})
"""Compile a function that only compiled functions call. The omitted Python wrapper is half of the compiled code."""
inlined: Callable[[_Function], _Function] = njit(**{**_LEAN, "forceinline": True, "no_cpython_wrapper": True})
"""Compile as :data:`called`, and copy the compiled code into its callers. For short functions called at every step."""
pasted: Callable[[_Function], _Function] = njit(**{**_LEAN, "inline": "always"})
"""Copy a function into its caller before types are inferred. For a short function with one caller.

With a long function or several callers, repeated type inference takes longer than a separate compilation.
"""
