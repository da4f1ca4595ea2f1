"""Text on the terminal: a number and its unit stay in one line."""

from __future__ import annotations

import io

import pytest
from rich.console import Console, Group
from rich.table import Table

from gcs_autotune.report.toolkit.tied import TiedText


def shown(text: str, width: int) -> list[str]:
    console = Console(file=io.StringIO(), width=width)
    with console.capture() as capture:
        console.print(Group(TiedText(text)))
    return [line.rstrip() for line in capture.get().splitlines()]


@pytest.mark.parametrize("quantity", ["1 %", "2.68 s²", "0.3 m/s", "200 ms", "5 min", "12 °/s", "3 deg/s", "4 m."])
def test_no_line_begins_with_a_unit(quantity: str) -> None:
    text = f"overshoot of {quantity} then more"
    for width in range(14, 30):
        lines = shown(text, width)
        assert any(quantity in line for line in lines), (width, lines)
        assert " ".join(lines) == text


def test_words_after_a_number_may_wrap() -> None:
    assert shown("turned by 12 millimetres", 14) == ["turned by 12", "millimetres"]


@pytest.mark.parametrize(
    ("name", "width", "lines"),
    [
        ("quadratic-actuator@N.share", 20, ["quadratic-actuator@", "N.share"]),
        ("quadratic-actuator@N.share", 12, ["quadratic-", "actuator@N.", "share"]),
        (
            "of runs/20261129-121654-blueboat/report.html",
            20,
            ["of runs/20261129-", "121654-blueboat/", "report.html"],
        ),
        ("unbreakable", 8, ["unbreaka", "ble"]),
        ("dead-zone.width", 15, ["dead-zone.width"]),
    ],
)
def test_a_name_that_is_too_wide_breaks_between_its_pieces(name: str, width: int, lines: list[str]) -> None:
    assert shown(name, width) == lines


def test_a_cell_is_wide_enough_for_a_number_with_its_unit() -> None:
    table = Table.grid()
    table.add_column()
    table.add_column()
    table.add_row(TiedText("a long text that takes all the width"), TiedText("5.11 -> 2.68 s²"))
    console = Console(file=io.StringIO(), width=30)
    with console.capture() as capture:
        console.print(table)
    assert any("2.68 s²" in line for line in capture.get().splitlines())
