"""Reference pages made from the code: commands from their parsers, errors, parameters written, limits, bibliography."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from pathlib import Path

from gcs_autotune.cli import make_parser
from gcs_autotune.errors import EXIT_CODES, AutotuneError
from gcs_autotune.firmware import ALIASES, FIRMWARE
from gcs_autotune.limits import LIMITS

__all__ = ["PAGES", "write"]

MADE = "% Made by docs/site_reference.py when the site is built; not to be edited.\n\n"


def write(folder: Path) -> None:
    """Write every page of :data:`PAGES` whose text has changed."""
    folder.mkdir(exist_ok=True)
    for name, make in PAGES.items():
        text, path = MADE + make(), folder / f"{name}.md"
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def plain(text: str) -> str:
    """Return *text* so that Markdown shows it as it is."""
    return re.sub(r"([\\`*_<>\[\]|$#{}~])", r"\\\1", " ".join(text.split()))


def commands() -> str:
    """Return the page of all commands and their options."""
    lines = [
        "# Commands",
        "",
        "The texts are those of `--help-all`. `--help` shows the everyday options and examples.",
        "",
    ]
    for path, parser in _parsers(make_parser(), ()):
        lines += [f"{'#' * (1 + len(path))} {' '.join(path)}", "", plain(parser.description or ""), ""]
        for group in parser._action_groups:
            shown = [
                a
                for a in group._group_actions
                if a.help is not argparse.SUPPRESS and a.dest not in ("help", "help_all")
            ]
            shown = [a for a in shown if not isinstance(a, argparse._SubParsersAction)]
            if shown and group.title not in ("positional arguments", "options", None):
                lines += [f"**{plain(group.title)}**", ""]
            for action in shown:
                lines += [_option(action), f": {plain(_help(parser, action))}", ""]
    return "\n".join(lines) + "\n"


def _parsers(
    parser: argparse.ArgumentParser, path: tuple[str, ...]
) -> Iterator[tuple[tuple[str, ...], argparse.ArgumentParser]]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, below in action.choices.items():
                yield (*path, name), below
                yield from _parsers(below, (*path, name))


def _option(action: argparse.Action) -> str:
    word = action.metavar or ("{" + ",".join(map(str, action.choices)) + "}" if action.choices else "")
    word = word if isinstance(word, str) else " ".join(word)
    takes = "" if action.nargs == 0 else word.replace("%%", "%") or action.dest.upper()
    names = ", ".join(action.option_strings)
    return f"`{' '.join(filter(None, (names, takes)))}`"


def _help(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    return parser._get_formatter()._expand_help(action) if action.help else action.dest


def errors() -> str:
    """Return the page of exit codes and kinds of messages."""
    lines = ["# Messages and exit codes", "", "| code | meaning |", "|---|---|", "| 0 | done |"]
    lines += ["| 8 | tuned, but the old gains proved better and are restored (`tune`) |"]
    lines += [f"| {code} | {plain(meaning)} |" for _, code, meaning in sorted(EXIT_CODES, key=lambda row: row[1])]
    lines += [
        "",
        "Every error is one line on standard error. It states what happened, to what, and what to do. `--verbose` adds",
        "where in the code it occurred.",
        "",
        "The list shows the kinds of errors. They are also the exceptions of the Python interface",
        "(`gcs_autotune.errors`). An indented kind is a special case of the kind above it. If the table has no exit",
        "code for a kind, the code of the kind above it applies.",
        "",
    ]
    lines += _family(AutotuneError, 0)
    return "\n".join(lines) + "\n"


def _family(kind: type[BaseException], depth: int) -> list[str]:
    own = [f"{'  ' * depth}* `{kind.__name__}`: {plain((kind.__doc__ or '').partition(chr(10))[0])}"]
    return own + [line for below in kind.__subclasses__() for line in _family(below, depth + 1)]


def parameters() -> str:
    """Return the page of parameters that a tune may write."""
    lines = [
        "# Parameters written",
        "",
        "A tune writes only the parameters of its axis. It asks first, and stores the old values in a journal on disk.",
        "The ranges are ArduPilot's documented ones. Values outside are proposed only with `--beyond-ranges`. Some",
        "names differ between firmware versions. The tool uses the names that the vehicle has.",
        "",
    ]
    others = {name: ", ".join(f"`{a.name}`" for a in aliases) for name, aliases in ALIASES.items()}
    for firmware in FIRMWARE.values():
        lines += [f"## {firmware.name}", ""]
        for axis in firmware.axes.values():
            lines += [f"### {axis.name}", "", "| parameter | range | meaning | other names |", "|---|---|---|---|"]
            lines += [
                f"| `{g.parameter}` | {g.low:g} to {g.high:g} | {plain(g.meaning)} | {others.get(g.parameter, '')} |"
                for g in axis.gains
            ]
            lines.append("")
    return "\n".join(lines) + "\n"


def limits() -> str:
    """Return the page of every number's range."""
    lines = ["# Numbers and their ranges", "", "| option | meaning | range | reason |", "|---|---|---|---|"]
    for row in LIMITS.values():
        name = f"`--{row.name}`" + (f" ({row.axis})" if row.axis else "")
        lines.append(f"| {name} | {plain(row.meaning)} | {plain(row.range)} | {plain(row.reason)} |")
    return "\n".join(lines) + "\n"


_ENTRY = re.compile(r"^@\w+\{(\w+),\s*(.*)\}\s*$", re.MULTILINE)
_FIELD = re.compile(r"(\w+) = \{((?:[^{}]|\{[^{}]*\})*)\}")


def bibliography() -> str:
    """Return the page of sources, by the keys that docstrings and comments cite."""
    text = (Path(__file__).parent / "references.bib").read_text(encoding="utf-8")
    lines = ["# Bibliography", "", "The keys are those used in docstrings, comments and pages.", ""]
    for key, body in _ENTRY.findall(text):
        fields = {name: _unbraced(value) for name, value in _FIELD.findall(body)}
        where = fields.get("journal") or fields.get("booktitle") or fields.get("publisher") or fields.get("school", "")
        words = ", ".join(filter(None, (fields.get("author", "").replace(" and ", ", "), fields.get("title"), where)))
        volume = f" {fields['volume']}" if "volume" in fields else ""
        lines += [f"{key}", f": {plain(words)}{volume}, {fields.get('year', '')}", ""]
    return "\n".join(lines) + "\n"


_ACCENTS = {r"{\o}": "ø", r"{\"u}": "ü", r"{\"o}": "ö", r"{\"a}": "ä", r"{\'c}": "ć", r"{\v{s}}": "š", r"{\v{c}}": "č"}


def _unbraced(text: str) -> str:
    for code, letter in _ACCENTS.items():
        text = text.replace(code, letter)
    return re.sub(r"\\[\"'`^v]|[{}\\]", "", text)


def effects() -> str:
    """Return the page of effects that a diagnosis looks for."""
    from gcs_autotune.effects import EFFECTS

    lines = ["# Effects", "", "`diagnose` searches for these effects, and `identify --effects` fits them.", ""]
    for effect in EFFECTS.values():
        numbers = ", ".join(f"`{q.name}` [{plain(q.unit)}]" for q in effect.parameters) or "none"
        lines += [
            f"## {effect.slug}",
            "",
            f"{plain(effect.meaning[:1].upper() + effect.meaning[1:])}.",
            "",
            f"* Parameters: {numbers}",
            f"* Shown by: {plain(effect.shown_by)}",
            f"* Easily mistaken for: {', '.join(effect.mistaken_for) or 'nothing'}",
            f"* Distinguished by: {plain(effect.separated_by)}",
            "",
        ]
    return "\n".join(lines) + "\n"


HEADING, SPEED, DEPTH = "experiment heading", "experiment speed", "experiment depth"
ABOARD: dict[str, tuple[str, str, str]] = {
    "time-scale": (HEADING, "charlie", ".factor=1.02"),
    "time-offset": (HEADING, "charlie", ".offset=0.5"),
    "unit-error": (HEADING, "charlie", "@r.factor=57.3"),
    "sign-error": (HEADING, "charlie", "@r"),
    "channel-swap": ("fly zig-zag", "charlie", "@x+y"),
    "input-delay": (HEADING, "videoray", ".delay=0.4"),
    "saturation": (HEADING, "videoray", ".limit=0.3"),
    "rate-limit": (HEADING, "charlie", ".rate=0.3"),
    "actuator-lag": (HEADING, "videoray", ".time_constant=0.4"),
    "backlash": (HEADING, "charlie", ".width=0.1"),
    "dead-zone": (HEADING, "videoray", ".width=0.05"),
    "quadratic-actuator": (HEADING, "videoray", ".share=1"),
    "rudder-stall": (HEADING, "charlie", ".angle=0.4,drop=1"),
    "asymmetric-thrust": (HEADING, "videoray", ".ratio=0.7"),
    "command-coupling": ("experiment surge", "charlie", ".gain=0.2"),
    "gain-drift": (HEADING, "videoray", ".rate=0.003"),
    "speed-dependent-steering": ("fly zig-zag", "charlie", ".share=1"),
    "propeller-wash": ("tune heading", "charlie", ".share=0.8"),
    "advance-speed-loss": (HEADING, "videoray", ".loss=0.5"),
    "linear-drag": (HEADING, "videoray", ".coefficient=0.01"),
    "quadratic-drag": (HEADING, "videoray", ".coefficient=0.02"),
    "speed-damping": ("fly zig-zag", "charlie", ".N_|u|r=-20"),
    "velocity-product": ("fly zig-zag", "charlie", "@N_u.coefficient=5"),
    "mass-change": (HEADING, "videoray", ".ratio=1.5,time=40"),
    "net-buoyancy": (DEPTH, "videoray", ".force=-2"),
    "ground-effect": (DEPTH, "videoray", ".strength=1,length=1,bottom=6"),
    "input-bias": (HEADING, "charlie", ".bias=0.05"),
    "steady-current": ("fly turning-circle", "charlie-sway", ".V_x=0.3"),
    "changing-current": ("fly turning-circle", "charlie-sway", ".V_x=0.3,turn=0.02"),
    "wind-moment": (HEADING, "charlie", ".strength=0.1,direction=1"),
    "wind-load": ("fly turning-circle", "charlie-sway", ".direction=1,X=20,Y=40,N=10"),
    "wave-disturbance": (HEADING, "charlie", ".amplitude=0.1,frequency=1.2"),
    "tether-pull": (HEADING, "videoray", ".stiffness=0.02"),
    "tether-line": (DEPTH, "videoray", ".length=4,stiffness=20"),
    "shallow-water": ("fly turning-circle", "charlie-sway", ".draught=0.5,depth=1.5,north=0.02,drag=80"),
    "bank-suction": ("fly turning-circle", "charlie-sway", ".direction=0,distance=30,Y=900,N=500"),
    "sensor-position": ("fly turning-circle", "charlie-sway", ".x_P=1"),
    "compass-deviation": (HEADING, "charlie", ".B=0.1"),
    "gyro-bias": (HEADING, "charlie", ".bias=0.02"),
    "measurement-delay": (HEADING, "videoray", ".delay=0.4"),
    "quantisation": (HEADING, "videoray", ".step=0.05"),
    "outliers": (HEADING, "charlie", "@r.share=0.03,size=0.3"),
    "coriolis-coupling": ("fly turning-circle", "charlie-sway", ".N_uv=100"),
    "sway-yaw-coupling": ("fly turning-circle", "charlie-sway", ".N_v=100"),
    "sway-moment": ("fly turning-circle", "charlie-sway", ".N_v=100"),
    "munk-moment": ("fly turning-circle", "charlie-sway", ".N_uv=100"),
}
"""Effect -> the command that flies it, the simulated vehicle, and place and size of the effect."""


def link_with(slug: str) -> str:
    """Return the link to a simulated vehicle that hides the effect *slug*."""
    _, vehicle, size = ABOARD[slug]
    return f"sitl:{vehicle}?effect={slug}{size}&seed=3"


def hide_and_find() -> str:
    """Return the page that shows how to hide each effect in a simulated vehicle, and how to find it."""
    from gcs_autotune.effects import EFFECTS

    lines = [
        "# Hide an effect, and find it",
        "",
        "A simulated vehicle can hide any of these effects. You can then test whether `diagnose` identifies it. The",
        "tuner is connected to the vehicle only by MAVLink, and has no information about the effect. `diagnose`",
        "without further options tries all effects.",
        "",
        "The sizes are for a craft of a few metres. A much smaller effect is hidden by the noise. The",
        "[benchmarks](../../benchmarks/README.md) show how often a diagnosis is right. A",
        "[tutorial](../tutorials/wrong-simulation.md) identifies a cause step by step.",
        "",
    ]
    for effect in EFFECTS.values():
        if effect.slug not in ABOARD:  # of another package
            continue
        what = ABOARD[effect.slug][0]
        others = ", ".join(f"[{name}](#{name})" for name in effect.mistaken_for)
        lines += [
            f"## {effect.slug}",
            "",
            f"{plain(effect.meaning[:1].upper() + effect.meaning[1:])}.",
            "",
            "```sh",
            f"gcs-autotune {what} --connect '{link_with(effect.slug)}' --out runs/{effect.slug}",
            f"gcs-autotune diagnose runs/{effect.slug}",
            "```",
            "",
            f"* Shown by: {plain(effect.shown_by)}",
            *([f"* Easily mistaken for: {others}"] if others else []),
            *([f"* Distinguished by: {plain(effect.separated_by)}"] if others else []),
            "",
        ]
    return "\n".join(lines) + "\n"


PAGES = {
    "commands": commands,
    "errors": errors,
    "parameters": parameters,
    "limits": limits,
    "effects": effects,
    "hide_and_find": hide_and_find,
    "bibliography": bibliography,
}
"""Name of a page -> what makes it."""
