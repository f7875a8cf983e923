"""The recorder, on a line without a board that answers by Tables E.1 and E.2, and on the virtual board."""

from __future__ import annotations

import struct
from typing import Iterator

import pytest

from conftest import Line, VirtualBoard, told
from handwheel import Board, OutOfRange, Refused
from handwheel.frame import Frame
from handwheel.recorder import Recorder
from handwheel.session import Session
from handwheel.watch import Watch

#: Motors 1 and 3, at a motion command, every 2 ms, 9 samples of which 3 before: 18 rows, 3 blocks.
STATE = struct.pack("<BBBBHHHHIH", 7, 3, 0b101, 1, 2, 9, 9, 3, 123_456, 400)
ROWS = [struct.pack("<iihhHB", number, -number, 4000, 8192, 728, 3) for number in range(18)]


class Recordings:
    """A board with a recorder, which loses the second block, once."""

    def __init__(self) -> None:
        self._has_lost = False

    def answer(self, asked: Frame) -> Iterator[Frame]:
        if asked.did == 104:
            yield told(104, STATE)
        elif asked.did == 105:
            first, count = struct.unpack("<HH", asked.data)
            for number in range(first, first + count):
                if number == 1 and not self._has_lost:
                    self._has_lost = True
                else:
                    yield told(105, struct.pack("<BH", 7, number) + b"".join(ROWS[8 * number : 8 * number + 8]))


def test_a_recording_is_asked_for_and_read_and_what_is_lost_asked_for_again() -> None:
    line = Line(Recordings().answer)
    session = Session("line", line, Watch())
    recorder = Recorder(session, 3)
    started = recorder.start([1, 3], samples=9, trigger="motion", every_ms=2, before=3)
    rows = recorder.read()
    session.close()

    assert line.written[0].data == struct.pack("<BBHHH", 0b101, 1, 2, 9, 3)
    assert (started.serial, started.phase, started.motors, started.trigger) == (7, "done", (1, 3), "motion")
    assert (started.every_ms, started.samples, started.taken, started.before) == (2, 9, 9, 3)
    assert (started.trigger_ms, started.capacity) == (123_456, 400)
    assert [frame.data for frame in line.written if frame.did == 105] == [struct.pack("<HH", 0, 3)] * 2
    assert {frame.did for frame in line.written} == {104, 105}, "nothing that keeps anything running"
    assert [row.position for row in rows] == list(range(18))
    assert [(row.time_ms, row.motor) for row in rows[:3]] == [(-6, 1), (-6, 3), (-4, 1)]
    assert rows[6].time_ms == 0
    assert rows[5][3:] == (-5, 4000, 0.5, 1.0, "velocity")


def test_what_cannot_be_recorded_is_refused_before_anything_is_sent() -> None:
    line = Line(Recordings().answer)
    session = Session("line", line, Watch())
    recorder = Recorder(session, 3)
    with pytest.raises(OutOfRange, match="samples before the trigger: 9 is out of range, 0 to 8"):
        recorder.start([1], samples=9, before=9)
    with pytest.raises(OutOfRange, match="0 to 0"):
        recorder.start([1], samples=9, before=1, trigger="now")
    with pytest.raises(OutOfRange, match="motor: 7 is out of range, 1 to 6"):
        recorder.start([7], samples=9)
    with pytest.raises(Refused, match="now, motion, fault"):
        recorder.start([1], samples=9, trigger="later")
    with pytest.raises(Refused, match="bring its firmware up to date"):
        Recorder(session, 2).read()
    session.close()
    assert line.written == []


def test_a_step_is_recorded(virtual: VirtualBoard) -> None:
    with Board(virtual.tcp) as board:
        assert board.recorder.is_there
        board.settings["sensor 1"] = 3  # the encoder, or the first command implies it, and the position jumps
        board.recorder.start([1], samples=300, before=20)
        assert board.recorder.state.phase == "waiting"
        board.motor[1].run(velocity=4000)
        rows = board.recorder.read()
    assert [row.time_ms for row in rows] == list(range(-20, 280))
    assert all(row.mode == "off" and row.velocity == 0 for row in rows[:20])
    assert rows[21].set_point == 4000 and rows[-1].velocity == pytest.approx(4000, rel=0.1)
    assert [row.position for row in rows] == sorted(row.position for row in rows)


def test_a_recording_that_waits_for_a_fault_says_so(virtual: VirtualBoard) -> None:
    with Board(virtual.tcp) as board:
        board.recorder.start([1, 2], samples=50, before=10, trigger="fault")
        with pytest.raises(Refused, match="still waiting"):
            board.recorder.read(timeout=0.1)
