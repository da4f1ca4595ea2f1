"""Table of the identification methods. Each is loaded when it is first used."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module

from gcs_autotune.identify.method import Method
from gcs_autotune.methods import METHOD_PLACES

__all__ = ["METHODS"]


class _Methods(Mapping[str, Method]):
    """Mapping from the name of a method to the method. A method's module is imported on first use."""

    def __init__(self) -> None:
        self._loaded: dict[str, Method] = {}

    def __getitem__(self, name: str) -> Method:
        if name not in self._loaded:
            module, _, attribute = METHOD_PLACES[name].partition(":")
            self._loaded[name] = getattr(import_module(module), attribute)
        return self._loaded[name]

    def __iter__(self) -> Iterator[str]:
        return iter(METHOD_PLACES)

    def __len__(self) -> int:
        return len(METHOD_PLACES)


METHODS: Mapping[str, Method] = _Methods()
