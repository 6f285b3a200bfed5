"""What a drive commanded and measured, in a recording: every cycle of it, and as a table."""

import csv

import numpy as np
import pytest
from families import rig_of
from small_rig import REPORT, swing

from drivers.drive import drive
from drivers.emulation.in_process import InProcess
from drivers.endpoint import StreamError
from drivers.played import Played
from drivers.recorded import hello_in
from drivers.recording import Recorder, Recording
from drivers.servos.connect import connect
from drivers.states import recorder_of, states_in, write_table
from drivers.watchdog import Patience
from rigcast import driving
from rigcast.__main__ import main


def record(kind, path):
    """Drive the swing with its log at `path`; what was driven, and the states that the drive told."""
    rig = rig_of(kind)
    wire, told = InProcess(rig), []
    with Recorder(path) as recorder:
        log = recorder_of(recorder, rig, 50.0)

        def watch(state):
            told.append(state)
            log(state)

        source = Played(swing(rig), rig, REPORT, Patience(hold_s=0.3, safe_s=0.6))
        done = drive(rig, source, connect(rig, wire), clock=wire, watch=watch)
    return done, told


@pytest.mark.parametrize("kind", ["dynamixel2", "lx16a", "maestro"])
def test_every_cycle_is_in_the_file(kind, tmp_path):
    done, told = record(kind, tmp_path / "run.rigrec")
    recording = Recording(tmp_path / "run.rigrec")
    assert list(states_in(recording)) == told
    assert len(told) == done.cycles
    assert hello_in(recording).joints == ("a", "b", "c")
    assert recording.lost == 0
    followed = [s for s in told if s.mode == "following" and s.command]
    error = np.array([s.command for s in followed]) - np.array([s.position for s in followed])
    np.testing.assert_allclose(np.sqrt((error**2).sum(0) / done.followed), done.rms_error, atol=0.02)


def test_as_a_table(tmp_path, capsys):
    _, told = record("dynamixel2", tmp_path / "run.rigrec")
    assert main(["bus", "log", str(tmp_path / "run.rigrec"), "--out", str(tmp_path / "run.csv")]) == 0
    assert f"{len(told)} rows" in capsys.readouterr().out
    with (tmp_path / "run.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0])[:5] == ["time_s", "mode", "reason", "a_command_rad", "a_position_rad"]
    for row, state in zip(rows, told, strict=True):
        assert row["mode"] == state.mode
        assert float(row["b_position_rad"]) == state.position[1]
        assert row["c_voltage_V"] == str(state.voltage[2])
        assert (row["a_command_rad"] == "") == (state.command == ())


def test_what_a_board_does_not_measure_has_no_column(tmp_path):
    record("maestro", tmp_path / "run.rigrec")
    write_table(Recording(tmp_path / "run.rigrec"), tmp_path / "run.csv")
    assert (tmp_path / "run.csv").read_text().splitlines()[0] == (
        "time_s,mode,reason,a_command_rad,a_position_rad,b_command_rad,b_position_rad,c_command_rad,c_position_rad"
    )


def test_a_drive_does_not_begin_over_a_log_that_is_there(tmp_path):
    rig, path = rig_of("feetech"), tmp_path / "run.rigrec"
    path.touch()
    source = Played(swing(rig), rig, REPORT)
    with pytest.raises(FileExistsError):
        driving.run(rig, "sim", source, driving.Driving(record=path), lambda: "")


def test_a_recording_without_a_hello_is_one_line(tmp_path):
    with Recorder(tmp_path / "empty.rigrec"):
        pass
    with pytest.raises(StreamError, match="no hello"):
        write_table(Recording(tmp_path / "empty.rigrec"), tmp_path / "x.csv")
