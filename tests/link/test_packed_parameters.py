"""The whole parameter set by MAVLink FTP, with the firmware's defaults; a vehicle without it is read one by one."""

from __future__ import annotations

import json
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scripted_vehicle import ScriptedVehicle

import sitl
from gcs_autotune.cli import main
from gcs_autotune.errors import BadFile
from gcs_autotune.link import MemoryLink, Parameters, Session
from gcs_autotune.link.file_transfer import read_remote_file
from gcs_autotune.mavlink import load_params, unpack_parameters
from sitl.mavlink.file_transfer import packed


def parameters_of(peer, **link) -> Parameters:
    session = Session(MemoryLink(peer, **link))
    session.discover()
    return Parameters(session)


def test_the_packed_set_equals_the_one_read_one_by_one_and_is_faster():
    parameters = parameters_of(sitl.open_vehicle("videoray"))
    begun = parameters.session.clock.now()
    found = parameters.read_whole()
    packed_took = parameters.session.clock.now() - begun
    begun = parameters.session.clock.now()
    assert found.values == pytest.approx(parameters.read_full())
    assert packed_took < 3.0
    assert found.types == {name: parameters.types[name] for name in found.values}
    assert parameters.session.notes == []


def test_a_changed_parameter_differs_from_its_default():
    parameters = parameters_of(sitl.open_vehicle("charlie"))
    before = parameters.read_whole()
    parameters.write("ATC_STR_RAT_P", 0.77)
    after = parameters.read_whole()
    assert set(after.changed) - set(before.changed) <= {"ATC_STR_RAT_P"}
    assert "ATC_STR_RAT_P" in after.changed
    assert after.defaults == before.defaults
    assert after.defaults["ATC_STR_RAT_P"] != pytest.approx(0.77)


@pytest.mark.parametrize("seed", range(4))
def test_lost_pieces_are_requested_again(seed):
    parameters = parameters_of(sitl.open_vehicle("charlie"), loss=0.1, seed=seed)
    assert parameters.read_whole().values == pytest.approx(parameters.read_full())


def test_a_vehicle_without_ftp_is_read_one_by_one_with_a_note(boat: ScriptedVehicle):
    parameters = parameters_of(boat)
    found = parameters.read_whole()
    assert found.values == pytest.approx(boat.parameters)
    assert found.defaults == {}
    assert found.changed == ()
    assert any("does not answer MAVLink FTP" in note for note in parameters.session.notes)


def test_a_missing_remote_file_is_reported():
    parameters = parameters_of(sitl.open_vehicle("charlie"))
    with pytest.raises(BadFile, match="no readable file /etc/passwd: the file does not exist"):
        read_remote_file(parameters.session, "/etc/passwd")


def test_mavproxys_reader_reads_the_same_values():
    param_ftp = pytest.importorskip("MAVProxy.modules.lib.param_ftp", reason="MAVProxy is not installed")
    data = packed(sitl.open_vehicle("videoray"), defaults=True)
    theirs, ours = param_ftp.ftp_param_decode(data), unpack_parameters(data)
    assert {n.decode(): v for n, v, _ in theirs.params} == ours.values
    assert {n.decode(): v for n, v, _ in theirs.defaults} == ours.defaults


DATA = packed(sitl.open_vehicle("charlie"), defaults=True)


@given(st.integers(0, len(DATA) - 1), st.integers(0, 255))
def test_a_damaged_file_is_read_or_raises_bad_file(at, byte):
    for damaged in (DATA[:at], DATA[:at] + bytes([byte]) + DATA[at + 1 :]):
        try:
            found = unpack_parameters(damaged)
        except BadFile:
            continue
        assert len(found.values) == struct.unpack_from("<H", DATA, 2)[0]


def test_params_save_prints_how_many_values_differ_from_the_defaults(tmp_path, capsys):
    path = tmp_path / "all.json"
    assert main(["params", "save", str(path), "--connect", "sitl:charlie"]) == 0
    assert "differ from the firmware's defaults)" in capsys.readouterr().out
    saved = json.loads(path.read_text())
    assert saved["parameters"].keys() == saved["defaults"].keys()
    assert load_params(path) == pytest.approx(saved["parameters"])
