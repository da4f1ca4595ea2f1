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
"""Compile a function that Python calls, and keep it on disk."""
entry_without_lock: Callable[[_Function], _Function] = njit(**{**_LEAN, "cache": True, "nogil": True})
"""The same, for a long one: other threads of Python go on meanwhile."""
called: Callable[[_Function], _Function] = njit(**{**_LEAN, "cache": True, "no_cpython_wrapper": True})
"""Compile a function that only compiled ones call: an entry for Python would be half of what there is to compile."""
inlined: Callable[[_Function], _Function] = njit(**{**_LEAN, "forceinline": True, "no_cpython_wrapper": True})
"""The same, copied into its callers once compiled, and stored with them: for what is short and called at every step."""
pasted: Callable[[_Function], _Function] = njit(**{**_LEAN, "inline": "always"})
"""The same, copied before types are known, and never compiled for itself: for what has one caller. Where a function is
long or has several callers, finding the types anew takes longer than that."""
