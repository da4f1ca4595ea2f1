"""The operator, who can stop everything and is asked before writes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

__all__ = ["Operator", "Unattended", "answers_questions"]


class Operator(Protocol):
    """A person who can stop the work and answer a question."""

    def stop_requested(self) -> bool:
        """Return whether Ctrl-C or its equivalent was pressed."""
        ...

    def ask(self, question: str, while_waiting: Callable[[], object]) -> bool:
        """Return the answer to a yes/no question.

        Call *while_waiting* repeatedly until then, to keep the link active.
        """
        ...


class Unattended:
    """No operator: ``--yes`` answers every question in advance."""

    answered_beforehand = True

    def __init__(self, answer: bool = True) -> None:
        self.answer = answer

    def stop_requested(self) -> bool:
        """Return False, because there is no operator who could request a stop."""
        return False

    def ask(self, question: str, while_waiting: Callable[[], object]) -> bool:
        """Return the answer set by ``--yes``."""
        return self.answer


def answers_questions(operator: Operator) -> bool:
    """Return whether *operator* can answer a question now. With ``--yes`` there is no operator."""
    return not getattr(operator, "answered_beforehand", False)
