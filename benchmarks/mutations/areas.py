"""What matters, by area, and the faults that are none."""

from __future__ import annotations

from pathlib import Path

__all__ = ["AREAS", "EQUIVALENT", "files_by_area"]

AREAS: dict[str, tuple[str, ...]] = {
    "kernels": ("**/*.py",),
    "safety": ("manoeuvres/*.py", "workflow/restore.py", "workflow/tunable_loop.py", "workflow/autopilot_loop.py"),
    "journal": ("**/journal.py", "**/parameter_transaction.py", "**/params_file.py", "mavlink/tlog.py"),
    "stamps": (
        "**/stamp_correction.py",
        "**/latency.py",
        "**/watchdog.py",
        "logs/dataflash.py",
        "logs/sample_store.py",
    ),
    "link": ("link/liveness.py", "link/parameters/*.py", "link/vehicle/*.py", "**/transport.py", "**/signing.py"),
    "results": (
        "**/chi_square.py",
        "**/frames.py",
        "**/sname.py",
        "**/trial.py",
        "design/margins.py",
        "design/open_loop.py",
        "design/selection.py",
        "design/step_metrics.py",
        "design/verdict.py",
        "diagnose/heldout.py",
        "diagnose/score.py",
        "identify/likelihood.py",
        "identify/problem.py",
        "identify/noise.py",
        "**/cleaning.py",
        "identify/whiteness.py",
        "**/least_squares.py",
        "identify/intake.py",
        "logs/channels.py",
    ),
}
"""Area -> patterns of the files in ``gcs_autotune`` that faults are put into; a file is in the first area that has it.
Rooms, or names in whatever room they are, so that a file may move; what matches nothing is an error."""

ONLY_WITH: dict[str, str] = {"kernels": "import njit"}
"""Area -> what must stand in a file: kernels are wherever something is compiled."""

WITHOUT: tuple[str, ...] = (
    "**/__init__.py",  # doors
    "manoeuvres/*_messages.py",  # words, which goldens hold
    "manoeuvres/table.py",  # data
    "link/vehicle/commands.py",  # what is sent and when, tried against a whole vehicle
    "link/vehicle/mavlink_craft.py",
    "link/vehicle/rates.py",
    "link/vehicle/bandwidth.py",
    "link/vehicle/congestion.py",
    "link/vehicle/other_stations.py",
)
"""Patterns of files that are left out of every area."""


def files_by_area(root: Path) -> dict[str, list[str]]:
    """Return area -> its files, relative to *root*.

    Raises
    ------
    LookupError
        A pattern matches no file: it has been renamed, and so must the pattern be.
    """
    package = root / "gcs_autotune"
    taken = {file for pattern in WITHOUT for file in _matching(package, pattern)}
    found = {}
    for area, patterns in AREAS.items():
        matching = {f for pattern in patterns for f in _matching(package, pattern)} - taken
        files = sorted(f for f in matching if ONLY_WITH.get(area, "") in f.read_text(encoding="utf-8"))
        if not files:
            raise LookupError(f"the area {area} of the mutations has no file")
        taken.update(files)
        found[area] = [str(f.relative_to(root)) for f in files]
    return found


def _matching(package: Path, pattern: str) -> list[Path]:
    files = list(package.glob(pattern))
    if not files:
        raise LookupError(f"no file of {package.name} is called {pattern} any more: say in {__file__} what it is now")
    return files


_WATCHDOG = "gcs_autotune/link/vehicle/watchdog.py::Watchdog.__init__: "
_FLAGS = '_LEAN: dict[str, Any] = {"cache": True, "_nrt": False, "no_cfunc_wrapper": True}'
_LEAN = _FLAGS.replace("}", ', "error_model": "numpy"}')
_NO_ENTRY = '"_nrt": False, "error_model": "numpy", "no_cpython_wrapper": True'
_ANY, _SAME = "Callable[[Callable[..., Any]], Callable[..., Any]]", "Callable[[_Function], _Function]"
_NO_WRAPPER = 'njit(**{**_LEAN, "no_cpython_wrapper": True})'
_OFF, _BOTH = ("True -> False",), ("True -> False", "False -> True")
_COUPLED = "gcs_autotune/models/coupled/kernel.py::"
EQUIVALENT: dict[str, str] = {
    "gcs_autotune/link/vehicle/setpoint_streamer.py::SetpointStreamer._is_released: True -> False in return True": (
        "waited for is anything but None"
    ),
    'gcs_autotune/frames.py::module: TypeVar("Number", float, NDArray[np.float64]) -> TypeVar(float, "Number", '
    "NDArray[np.float64])": "for the type checker only, which refuses it",
    "gcs_autotune/design/margins.py::_are_stable: closed[:, -1] != 0.0 -> closed[:, -1] == 0.0": (
        "each is then asked by itself, with the same answer"
    ),
    "gcs_autotune/mavlink/tlog.py::TlogReader.__init__: self.truncated = False -> pass": (
        "set at the end of every iteration; documented as complete only then"
    ),
    "gcs_autotune/mavlink/tlog.py::TlogReader.__init__: self.truncated = False -> return": "the same",
    "gcs_autotune/mavlink/tlog.py::TlogReader.__iter__: 0 -> 1 in end = position + _STAMP.size + (length or 0)": (
        "without a length it is not looked at"
    ),
    "gcs_autotune/mavlink/tlog.py::read_tlog: 1 -> 2 in is_empty = not stream.peek(1)": "whatever is buffered comes",
    "gcs_autotune/identify/least_squares.py::descend: 1e-6 -> 2e-06 in damping, worse, converged, trial = 1e-6, 4.0, "
    "False, 0": "where damping begins: doubled, and it is four times more or ten times less at the next step anyway",
    "gcs_autotune/link/vehicle/rc_monitor.py::RcMonitor.departed: not self._sent -> False": (
        "without anything sent there are no verdicts either"
    ),
    "gcs_autotune/design/selection.py::_fastest: is_flyable(high) -> False": (
        "forty bisections then end within 1e-12 of it"
    ),
    "gcs_autotune/design/selection.py::_fastest: 40 -> 41 in for _ in range(40):": "the bisection has long converged",
    "gcs_autotune/link/parameters/parameter_transaction.py::ParameterTransaction._release: "
    "self._left.clear() -> return": ("what was left is read for written names only, and every write says it anew"),
    "gcs_autotune/link/vehicle/vehicle_config.py::RcChannel.pwm: wanted > 0 -> wanted >= 0": (
        "nothing so small gets there: it is trim already"
    ),
    "gcs_autotune/link/vehicle/handshake.py::_follow_control_tick: True -> False in craft.session.wait_for("
    "lambda: True if craft.telemetry.ticks > seen else None, 2.0 / rate)": "waited for is anything but None",
    "gcs_autotune/identify/least_squares.py::descend: 1e-6 -> 2e-06 in damping, worse = max(1e-6, damping * worse), "
    "2.0 * worse": "where damping begins again: doubled, and it is four times more at the next step anyway",
    "gcs_autotune/mavlink/tlog.py::TlogReader.__init__: False -> True in self.truncated = False": (
        "set at the end of every iteration; documented as complete only then"
    ),
    "gcs_autotune/mavlink/tlog.py::TlogReader.__init__: 0 -> 1 in self._position = 0": (
        "nothing is buffered yet: the first look takes all there is and begins at 0"
    ),
    "gcs_autotune/link/parameters/parameter_transaction.py::ParameterTransaction._release: "
    "self._left.clear() -> pass": "what was left is read for written names only, and every write says it anew",
    "gcs_autotune/effects/kernels.py::following: m < pieces -> m <= pieces": (
        "at the last of a whole number of pieces the logarithm is infinite, and the end of the interval is less"
    ),
    **{
        f"gcs_autotune/effects/kernels.py::{name}: 0 -> 1 in stamps, values = np.empty(0), np.empty(0)": (
            "room that is made anew before anything is written"
        )
        for name in ("following", "limited", "fading")
    },
    **{
        f"gcs_autotune/identify/stamp_correction.py::_moves: {change}": "rounds that find nothing more change nothing"
        for change in ("not open_.any() -> False", "break -> continue", "np.isnan(nearest).all() -> False")
    },
    **{
        f"gcs_autotune/logs/sample_store.py::SampleStore.take_all: {change} -> False": "of nothing, nothing is added"
        for change in ("not len(t)", "not np.any(in_order)")
    },
    "gcs_autotune/logs/sample_store.py::Census.rate: 0.0 -> 1.0 in count, first, last = "
    "self.seen.get(kind, [0, 0.0, 0.0])": "the last is not after the first then either",
    "gcs_autotune/logs/dataflash.py::strays_of: np.abs(np.diff(t)) <= STRAY -> np.abs(np.diff(t)) < STRAY": (
        "only looked at more closely, and none is found"
    ),
    "gcs_autotune/logs/dataflash.py::strays_of: not np.any(~(np.abs(np.diff(t)) <= STRAY)) -> False": "the same",
    "gcs_autotune/logs/dataflash.py::_Decoder._believable: 1 -> 2 in last = np.maximum.accumulate(np.where(blank, -1, "
    "np.arange(len(place))))": "either is before the first",
    "gcs_autotune/logs/dataflash.py::_Decoder._believable: 0 -> 1 in last[last < 0] = int(np.argmax(~blank))": (
        "where the first is not blank, the first that is not is the first"
    ),
    "gcs_autotune/logs/dataflash.py::strays_of: 1 -> 2 in before, after = middle[: len(t)], "
    "middle[NEIGHBOURS + 1 : NEIGHBOURS + 1 + len(t)]": "an end beyond the end",
    "gcs_autotune/logs/dataflash.py::record_dataflash: 4096 -> 4097 in start = stream.read(4096)": (
        "a little more of it"
    ),
    "gcs_autotune/design/laws/kernel.py::_fly: abs(e) > loop.lead_max -> True": (
        "what is within it is clipped to itself"
    ),
    **{
        f"gcs_autotune/link/vehicle/rc_monitor.py::RcMonitor.{change}": why
        for change, why in {
            "__init__: self._since = 0.0 -> pass": "set by the first override, before which nobody is judged",
            "__init__: 0.0 -> 1.0 in self._since = 0.0": "the same",
            "__init__: self._memory = _MEMORY -> pass": "the same",
            "sent: not self._sent or dict(self._sent[-1][1]) != dict(values) -> True": (
                "the same values are remembered several times, and forgotten as soon"
            ),
        }.items()
    },
    "gcs_autotune/identify/cleaning.py::jumps_back: np.diff(stamps) < 0.0 -> np.diff(stamps) <= 0.0": (
        "three in a row must be older than the one before, which none of the same age is"
    ),
    "gcs_autotune/identify/cleaning.py::quantum: span <= 0.0 -> span < 0.0": "three levels span more than nothing",
    "gcs_autotune/identify/kalman/transition.py::measure: 0 -> 1 in if heading >= 0:": (
        "a state that is the heading comes first only where there is no velocity that a current could be turned into"
    ),
    "gcs_autotune/link/vehicle/watchdog.py::BootClock.from_ms: self.now >= t -> self.now > t": "the same time is set",
    **{
        f"gcs_autotune/link/vehicle/watchdog.py::BootClock.from_us: {change} in "
        "return self._near((time_usec % 2**32) * 1e-6, _WRAP_US)": "more turns are left, which are taken off next"
        for change in ("2 -> 3", "32 -> 33")
    },
    "gcs_autotune/link/vehicle/latency.py::Latency.round_trip: math.isnan(self._middle) -> True": (
        "it is reckoned anew, and is the same"
    ),
    **{
        f"{_WATCHDOG}{line} -> pass": "set by the first message, before anything reads it"
        for line in (
            "self._since = math.nan",
            "self._first = (math.nan, math.nan)",
            "self._stamp_heard = clock.now()",
        )
    },
    **{
        f"{_COUPLED}scratch: {size} in {text},": "room that is larger than what is used"
        for size, text in (
            ("6 -> 7", "np.zeros(6)"),
            ("12 -> 13", "np.zeros(12)"),
            ("3 -> 4", "np.zeros(3, dtype=np.int64)"),
            ("3 -> 4", "np.zeros(3)"),
            ("3 -> 4", "np.zeros((3, 3))"),
            ("6 -> 7", "np.zeros((6, 3))"),
            ("3 -> 4", "np.zeros((6, 3))"),
            ("6 -> 7", "np.zeros((6, n))"),
            ("6 -> 7", "np.zeros((6, q))"),
        )
    },
    **{
        f"gcs_autotune/{file}.py::module: {change} in {line}": "how it is compiled, and not what"
        for file, line, changes in (
            *((file, _LEAN, _BOTH) for file in ("models/simulation", "design/laws/kernel", "design/step_metrics")),
            ("models/simulation", f"_lean: {_ANY} = {_NO_WRAPPER}", _OFF),
            ("design/laws/kernel", '**{**_LEAN, "no_cpython_wrapper": True, "forceinline": True}', _OFF),
            ("models/simulation", "_compiled_sweep: Callable[..., bool] = njit(**_LEAN, nogil=True)(_sweep)", _OFF),
            ("models/coupled/kernel", _FLAGS.replace('"cache": True, "_nrt": False', _NO_ENTRY), _BOTH),
            ("models/coupled/kernel", f"_outer: {_SAME} = njit(cache=True, **_LEAN)", _OFF),
            ("models/coupled/kernel", f"_inner: {_SAME} = njit(forceinline=True, **_LEAN)", _OFF),
        )
        for change in changes
    },
    "gcs_autotune/design/laws/kernel.py::_fly: leads -> True": "what leads is not looked at where nothing does",
    "gcs_autotune/design/laws/kernel.py::_clip: value < low -> value <= low": "at the limit it is the limit",
    "gcs_autotune/design/laws/kernel.py::plant_of: abs(model.steady_velocity(1.0 - model.delta)) -> "
    "(model.steady_velocity(1.0 - model.delta))": "full output ahead gives no speed astern",
    **{
        f"gcs_autotune/models/simulation.py::{change}": why
        for change, why in {
            "_step: after * side -> (after) / (side)": "side is one or minus one",
            "_series: 2.0 * side -> (2.0) / (side)": "side is one or minus one",
            "_crossing: _value(w[0], middle, degree) * side -> (_value(w[0], middle, degree)) / (side)": (
                "side is one or minus one"
            ),
            "_step: after * side < 0.0 -> after * side <= 0.0": "where it ends at rest it crosses zero at the end",
            "_step: rate * rest <= REACH -> rate * rest < REACH": "the longest step and the rest are the same then",
            "_crossing: 60 -> 61 in for _ in range(60):": "the bisection has long converged",
            "simulate_explicit: 8 -> 9 in np.zeros((8, DEGREE + 1)),": "room that is larger than what is used",
            "simulate_explicit: 1 -> 2 in np.zeros((8, DEGREE + 1)),": "room that is larger than what is used",
            "_step: force >= 0.0 -> force > 0.0": "at rest without a force it stays so, on either side",
        }.items()
    },
    **{
        f"gcs_autotune/design/step_metrics.py::error_behind: std > 0.0 -> {change}": (
            "without noise a reading agrees with itself alone"
        )
        for change in ("True", "std >= 0.0")
    },
    "gcs_autotune/models/coupled/kernel.py::_carry: 1 -> 2 in column = free[P.delay] if P.delay >= 0 else -1": (
        "no column is any number below 0"
    ),
    "gcs_autotune/models/coupled/kernel.py::_factor: 1 -> 2 in column = first + i if first >= 0 else -1": (
        "no column is any number below 0"
    ),
    "gcs_autotune/identify/kalman/sweep.py::forward: rate <= 2.0 * now -> rate < 2.0 * now": "a tie of two rates",
    **{
        f"gcs_autotune/models/coupled/kernel.py::_advance: {change}": "one step is made one step"
        for change in ("1 -> 2 in if steps < 1:", "steps < 1 -> steps <= 1")
    },
    "gcs_autotune/models/coupled/kernel.py::_factor: x >= 0.0 -> x > 0.0": (
        "at zero a size has no slope: either side's is taken"
    ),
    "gcs_autotune/identify/kalman/sweep.py::forward: abs(mean[j]) < 1e9 -> abs(mean[j]) <= 1e9": "a tie, far away",
    "gcs_autotune/identify/kalman/sweep.py::forward: 6 -> 7 in M, M_inverse = np.zeros((6, 6)), "
    "np.zeros((len(P.active), len(P.active)))": "room that is larger than what is used",
    "gcs_autotune/identify/kalman/transition.py::sigma_step: 6 -> 7 in M, M_inverse = np.zeros((6, 6)), "
    "np.zeros((len(P.active), len(P.active)))": "room that is larger than what is used",
    "gcs_autotune/effects/kernels.py::_earlier: 1e70 -> 2e+70 in weight = 1.0 / (third * third + floor) ** 2 "
    "if third * third + floor < 1e70 else 1e-140": "either weight is as good as none",
    "gcs_autotune/effects/kernels.py::_earlier: third * third + floor < 1e70 -> third * third + floor <= 1e70": (
        "either weight is as good as none"
    ),
    "gcs_autotune/identify/kalman/sweep.py::forward: 8 -> 9 in for _ in range(8):": "a pace is found before, or never",
    **{
        f"gcs_autotune/effects/kernels.py::_earlier: {change}": (
            "where third differences are rounding every one of the cubics is right, however they are mixed"
        )
        for change in (
            "y.min -> y.max in swing = y.max() - y.min()",
            "h * h * h -> (h * h) / (h)",
            "1e-7 -> 2e-07 in floor = (1e-7 * swing / (h * h * h)) ** 2 + 1e-100",
            "1e-100 -> 2e-100 in floor = (1e-7 * swing / (h * h * h)) ** 2 + 1e-100",
            "third * third + floor -> (third * third) - (floor)",
        )
    },
    "gcs_autotune/effects/kernels.py::_nodes: 0.0 -> 1.0 in if len(gaps) and float(gaps.min()) >= usual > 0.0:": (
        "a short way to the same stamps"
    ),
    "gcs_autotune/identify/kalman/transition.py::sigma_step: 2 -> 3 in ends = np.zeros((2, n))": (
        "room that is larger than what is used"
    ),
    "gcs_autotune/effects/kernels.py::_fade: rate <= 0.0 -> rate < 0.0": "what does not fade is above any floor",
    "gcs_autotune/effects/narrow_band.py::_driven: 2 -> 3 in out = np.zeros((len(t), 2))": (
        "room that is larger than what is used"
    ),
    **{
        f"gcs_autotune/effects/narrow_band.py::_innovations: {change}": why
        for change, why in {
            "i > SETTLED -> i >= SETTLED": "one sample sooner or later the gain has settled alike, or has not",
            "abs(s - before) < 1e-12 * s -> abs(s - before) <= 1e-12 * s": "a tie of roundings",
            "1e-12 -> 2e-12 in settled = i > SETTLED and abs(s - before) < 1e-12 * s": "both are rounding",
            "abs(dt - last) > 1e-9 -> abs(dt - last) >= 1e-9": "a nanosecond",
            "1e-9 -> 2e-09 in if abs(dt - last) > 1e-9:": "a nanosecond",
            "3 -> 4 in P, x, g = stationary.copy(), np.zeros((3, k)), np.zeros(3)": (
                "room that is larger than what is used"
            ),
            "3 -> 4 in F, Q, A = np.eye(3), np.zeros((3, 3)), np.zeros((3, 3))": (
                "room that is larger than what is used"
            ),
        }.items()
    },
}
"""Fault (``Mutant.key``) -> why nobody could notice it: it changes nothing that anybody may rely on. Judged by hand."""
