"""The operator: may stop everything, and is asked before writes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

__all__ = ["Operator", "Unattended", "answers_questions"]


class Operator(Protocol):
    """A person who can stop the work and answer a question."""

    def stop_requested(self) -> bool:
        """Whether Ctrl-C (or its like) was pressed."""
        ...

    def ask(self, question: str, while_waiting: Callable[[], object]) -> bool:
        """Return the answer to a yes/no question; *while_waiting* is called meanwhile to keep the link alive."""
        ...


class Unattended:
    """No operator: every question is answered beforehand (``--yes``)."""

    answered_beforehand = True

    def __init__(self, answer: bool = True) -> None:
        self.answer = answer

    def stop_requested(self) -> bool:
        """Never."""
        return False

    def ask(self, question: str, while_waiting: Callable[[], object]) -> bool:
        """Return the answer of ``--yes``."""
        return self.answer


def answers_questions(operator: Operator) -> bool:
    """Whether *operator* answers a question now; with ``--yes`` there is no operator."""
    return not getattr(operator, "answered_beforehand", False)
