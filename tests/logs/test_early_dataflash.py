"""Onboard logs from before 2015: stamps in milliseconds, none on PARM and MSG, outputs under other names."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from early_onboard_log import PARAMETERS, as_binary, as_text, sailed

from gcs_autotune.errors import BadFile, NotInformative
from gcs_autotune.logs import cut_runs, load_runs, record, survey


@pytest.mark.parametrize("form", ["text", "binary"])
@pytest.mark.parametrize("firmware", ["ArduRover v2.46 (00000000)", "APM:Rover v3.1"])
def test_milliseconds_are_read_and_the_outputs_mapped_by_the_rc_parameters(
    tmp_path: Path, form: str, firmware: str
) -> None:
    path = tmp_path / ("old.log" if form == "text" else "old.bin")
    path.write_bytes(as_text(sailed(firmware)).encode() if form == "text" else as_binary(sailed(firmware)))
    log = record(path)
    assert log is not None
    (store,) = log.stores
    assert store.clock == "vehicle (TimeMS)"
    assert store.vehicle == firmware
    assert store.parameters == pytest.approx(PARAMETERS)
    assert store.span == pytest.approx((8.8, 48.7))
    (run,) = load_runs(path)
    assert np.ptp(run["N"].values) == pytest.approx(0.8)
    assert set(np.round(run["X"].values, 6)) == {0.5}
    assert run["psi"].t[:3] == pytest.approx([8.8, 8.9, 9.0])
    assert run["U"].t[:2] == pytest.approx([8.8, 9.0]), "GPS by its boot clock T, not by the time of the GPS week"
    assert log.meta["damaged_stamps"] == 0


def test_lines_above_the_log_name_the_firmware_and_are_not_damage(tmp_path: Path) -> None:
    path = tmp_path / "terminal.log"
    rows = [row for row in sailed() if row[0] != "MSG"]
    path.write_text(as_text(rows, "ArduRover V2.45 (a1b2)\nFree RAM: 2341\nAPM 2\n\n"), encoding="utf-8")
    log = record(path)
    assert log is not None
    assert log.stores[0].vehicle == "ArduRover V2.45 (a1b2)"
    assert log.meta["damaged"] == 0
    assert len(load_runs(path)) == 1


def test_a_log_without_stamps_is_reported_as_such(tmp_path: Path) -> None:
    path = tmp_path / "first.log"
    text = as_text([("MSG", ("ArduRover v2.40",)), *(("ATT", (k, 0.0, 0.0, 10.0)) for k in range(50))])
    path.write_text(text.replace("IccC, TimeMS,Roll", "IccC, Nr,Roll"), encoding="utf-8")
    with pytest.raises(BadFile, match=r"first\.log is a log of ArduRover v2\.40 whose messages have no timestamp"):
        record(path)


def test_a_log_of_the_old_px4_logger_is_reported_as_such(tmp_path: Path) -> None:
    path = tmp_path / "sess001.bin"
    heads = "FMT, 129, 11, TIME, Q, StartTime\nFMT, 130, 9, ATT, fff, Roll,Pitch,Yaw\n"
    path.write_text(heads + "TIME, 123456\nATT, 0.1, 0.1, 0.3\n" * 40, encoding="utf-8")
    with pytest.raises(BadFile, match=r"sess001\.bin is a log of PX4's old logger \(sdlog2\)"):
        record(path)


def test_a_copter_log_is_reported_as_such(tmp_path: Path) -> None:
    path = tmp_path / "copter.log"
    path.write_text(as_text(sailed("APM:Copter V3.2.1 (36b405fb)")), encoding="utf-8")
    with pytest.raises(NotInformative, match=r"copter\.log .*is of APM:Copter V3\.2\.1.*neither ArduRover nor ArduSub"):
        load_runs(path)


def test_a_log_without_parameters_names_the_option(tmp_path: Path) -> None:
    path = tmp_path / "bare.log"
    path.write_text(as_text([row for row in sailed() if row[0] != "PARM"]), encoding="utf-8")
    with pytest.raises(NotInformative, match=r"bare\.log .*no parameters.*--parameters FILE") as refused:
        load_runs(path)
    log = record(path)
    assert log is not None
    shown = str(survey(log, cut_runs(log)))
    for text in (str(refused.value), shown):
        assert not any(word in text for word in ("thin", "link", "answer", "set SERVOn_FUNCTION"))
    (run,) = load_runs(path, parameters=PARAMETERS)
    assert np.ptp(run["N"].values) == pytest.approx(0.8)
