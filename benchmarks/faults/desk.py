"""The desk's work of a faulted tune, made cheap: no link is touched by it, so the same answer may serve again.

``design_from`` is called once per vehicle, axis and present parameters (that the noise of this very step differs a
little is left out), and the report is drawn for one case in ten.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest import mock

import gcs_autotune.workflow  # noqa: F401 - two of its modules are patched by name

__all__ = ["cheap_desk"]

_PROPOSALS: dict[Any, Any] = {}
_REPORTS = 10
_DESIGN, _REPORT = "gcs_autotune.workflow.designing", "gcs_autotune.workflow.tune"


@contextmanager
def cheap_desk(subject: str, index: int) -> Iterator[None]:
    """While inside, design from what was designed before."""
    room = sys.modules[_DESIGN]
    really = room.design_from

    def design_from(model: Any, axis: Any, present: Mapping[str, float], spec: Any, **options: Any) -> Any:
        key = (subject, axis.name, tuple(sorted(present.items())))
        if key not in _PROPOSALS:
            _PROPOSALS[key] = really(model, axis, present, spec, **options)
        return _PROPOSALS[key]

    with ExitStack() as stack:
        stack.enter_context(mock.patch.object(room, "design_from", design_from))
        if index % _REPORTS:
            stack.enter_context(mock.patch.object(sys.modules[_REPORT], "write_story", lambda story, path: None))
        yield
