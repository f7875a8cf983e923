"""The session on a line without a board: what is sent again, what is refused, and who is kept alive."""

from __future__ import annotations

import struct
import threading
import time
from typing import Callable, Iterable, Iterator

import pytest

from conftest import Line, becomes, told
from handwheel import Gone, NoAnswer, Refused, extension, session
from handwheel.frame import Frame
from handwheel.session import Session, sign_of_life
from handwheel.watch import Watch

ACK = Frame(255, b"\x01", rid=0, res=0)
PING = Frame(255, b"\x00", rid=0, res=0)
SIGN_OF_LIFE = Frame(255, b"\x00")
SAVE = bytes((extension.SAVE,))


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "_PATIENCE", 0.1)
    monkeypatch.setattr(session, "_SILENCE", 0.4)


@pytest.fixture
def begin() -> Iterator[Callable[[Line], Session]]:
    sessions = []

    def begin(line: Line) -> Session:
        sessions.append(Session("line", line, Watch()))
        return sessions[-1]

    yield begin
    for one in sessions:
        one.close()


def outcome(verdict: int, setting: int = 0) -> Frame:
    return told(101, struct.pack("<BBBH", 7, extension.SAVE, verdict, setting))


def in_turn(*answers: list[Frame]) -> Callable[[Frame], Iterable[Frame]]:
    left = iter(answers)
    return lambda frame: next(left, [])


def test_a_command_is_sent_again_until_it_is_acknowledged(begin: Callable[[Line], Session]) -> None:
    line = Line(in_turn([], [PING], [ACK]))
    begin(line).command(session.GPIO, b"\xa5", "outputs")
    assert line.written == [Frame(22, b"\xa5", res=0)] * 3


def test_a_motion_command_is_not_sent_again_behind_a_stop(begin: Callable[[Line], Session]) -> None:
    line, watch = Line(lambda frame: [PING]), Watch()
    one = begin(line)
    watch.begin(1, "velocity", 26)
    threading.Timer(0.05, watch.stopping, [[1]]).start()
    with pytest.raises(NoAnswer):
        one.command(session.VELOCITY, b"\x00\x64\x00", "a motion command", lambda: watch.drives(1))
    assert len(line.written) == 1


def test_what_has_no_answer_is_sent_four_times(begin: Callable[[Line], Session]) -> None:
    silent, speaking = Line(lambda frame: []), Line(lambda frame: [PING])
    with pytest.raises(Gone, match="line: the link is gone .the board says nothing any more.; see that"):
        begin(silent).command(session.GPIO, b"\xa5", "outputs")
    with pytest.raises(NoAnswer, match="the board does not answer when asked for outputs"):
        begin(speaking).command(session.GPIO, b"\xa5", "outputs")
    assert len(silent.written) == len(speaking.written) == 4


def test_a_busy_board_is_asked_again_and_a_refusal_tells_why(begin: Callable[[Line], Session]) -> None:
    line = Line(in_turn([outcome(7)], [outcome(0)], [outcome(4, 33)]))
    one = begin(line)
    one.order(SAVE, "a save")
    assert len(line.written) == 2
    with pytest.raises(Refused, match="the board refuses: a value is out of its range") as refused:
        one.order(SAVE, "a save")
    assert refused.value.setting == 33


def test_what_another_host_is_told_is_no_answer(begin: Callable[[Line], Session]) -> None:
    others = told(101, struct.pack("<BBBH", 7, extension.CLEAR_FAULTS, 6, 0))
    line = Line(in_turn([others, Frame(101, outcome(6).data, rid=1), outcome(0)]))
    begin(line).order(SAVE, "a save")
    assert len(line.written) == 1


def test_signs_of_life_are_sent_while_something_is_driven_and_a_board_is_heard() -> None:
    line, watch = Line(lambda frame: []), Watch()
    one = Session("line", line, watch)
    one.sign_of_life = 0.02
    line.tell(PING)
    time.sleep(0.1)
    assert line.written == []
    watch.begin(1, "velocity", 26)
    line.tell(PING)
    becomes(lambda: line.written.count(SIGN_OF_LIFE) > 5, within=2)
    assert {frame.did for frame in line.written} == {255, extension.STATE}
    time.sleep(0.6)
    count = len(line.written)
    time.sleep(0.1)
    assert len(line.written) == count, "a board that says nothing is not kept running"
    line.tell(PING)
    becomes(lambda: len(line.written) > count, within=2)
    watch.stopping([1])
    time.sleep(0.1)
    count = len(line.written)
    time.sleep(0.1)
    assert len(line.written) == count
    one.close()


def test_a_sign_of_life_is_a_quarter_of_the_timeout() -> None:
    assert [sign_of_life(ms) for ms in (0, 1, 400, 2000, 60_000)] == [0.5, 0.01, 0.1, 0.5, 0.5]
