"""What is driven, what keeps it running, and what stops it."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest

from conftest import OtherHost, VirtualBoard, becomes
from handwheel import Board, BoardFault, Gone, NotConfirmed, OutOfRange, Refused, session

#: DATA of a velocity of 4000 counts/s, and of sub-command 80 for the link timeout, number 1.
MOTOR_1_RUNS = (0, 0xA0, 0x0F)
MOTOR_2_RUNS = (1, 0xA0, 0x0F)
VELOCITY, PARAMETERS, RUN = 26, 7, 30
TIMEOUT_400_MS = (0x80, 1, 0, 0x90, 1, 0, 0)
TIMEOUT_700_MS = (0x80, 1, 0, 0xBC, 2, 0, 0)


@pytest.mark.parametrize("way", ["tcp", "udp", "serial"])
def test_a_motor_runs_is_measured_and_is_off_when_the_block_is_left(virtual: VirtualBoard, way: str) -> None:
    with Board(virtual.links[way]) as board:
        motor = board.motor[1]
        motor.run(velocity=4000)
        assert (motor.mode, motor.set_point) == ("velocity", 4000)
        becomes(lambda: abs(motor.velocity - 4000) < 400, within=3)
        becomes(lambda: motor.position > 1000, within=3)
        assert motor.duty > 0.1 and motor.reason is None
        assert motor.current == pytest.approx(virtual.truth["motors"][0]["current_a"], abs=0.2)
        assert virtual.is_on(1)
    truth = virtual.truth["motors"][0]
    assert (truth["enabled"], truth["duty"]) == (False, 0)
    assert abs(truth["velocity"]) < 50


def test_positions_duties_and_times(virtual: VirtualBoard) -> None:
    with Board(virtual.tcp) as board:
        wheel, joint = board.motor[1], board.motor[3]
        wheel.run(position=1000, time=0.5)
        joint.run(duty=-0.25, time=0.2)
        becomes(lambda: 0 < wheel.set_point < 900, within=0.5)
        becomes(lambda: wheel.set_point == 1000, within=3)
        becomes(lambda: abs(wheel.position - 1000) < 50, within=3)
        assert wheel.mode == "position"
        becomes(lambda: joint.duty == -0.25, within=3)
        assert (joint.mode, joint.set_point) == ("PWM", -0.25)
        joint.stop()
        assert joint.mode == "off" and wheel.mode == "position"
        wheel.run(velocity=-2000)  # from one method to the other
        becomes(lambda: wheel.velocity < -1000, within=3)


def test_an_exception_in_the_block_stops_the_motor(virtual: VirtualBoard) -> None:
    with pytest.raises(ZeroDivisionError):
        with Board(virtual.tcp) as board:
            board.motor[2].run(duty=0.3)
            becomes(lambda: virtual.is_on(2), within=1)
            print(1 / 0)
    assert not virtual.is_on(2)


def test_a_program_that_is_killed_leaves_the_motor_to_the_boards_timeout(virtual: VirtualBoard) -> None:
    program = (
        "import sys, time; from handwheel import Board; board = Board(sys.argv[1]);"
        "board.settings['link timeout'] = 1000; board.motor[1].run(velocity=4000); print('drives', flush=True); time.sleep(60)"
    )
    host = subprocess.Popen([sys.executable, "-c", program, virtual.tcp], stdout=subprocess.PIPE, text=True)
    assert host.stdout is not None and host.stdout.readline() == "drives\n"
    time.sleep(1.3)
    assert virtual.is_on(1), "it is kept running for longer than the board's timeout"
    host.send_signal(signal.SIGKILL)
    host.wait()
    assert 0.3 < becomes(lambda: not virtual.is_on(1), within=2)


def test_who_only_reads_keeps_nothing_running(virtual: VirtualBoard, other_host: OtherHost) -> None:
    with Board(virtual.tcp) as board:
        other_host.send(PARAMETERS, *TIMEOUT_700_MS)
        other_host.send(VELOCITY, *MOTOR_1_RUNS)
        becomes(lambda: virtual.is_on(1), within=2)
        end = time.monotonic() + 3
        while virtual.is_on(1):
            assert time.monotonic() < end, "it is kept running"
            board.check()
            assert (board.motor[1].mode, board.sonar_cm[0], board.inputs[0]) is not None
            assert board.settings["link timeout"] == 700
            assert len(board.faults) <= 1
        assert board.motor[1].reason == "the host fell silent"
        assert [fault.name for fault in board.faults] == ["link loss"]


@pytest.mark.parametrize("is_set_before", [True, False])
def test_signs_of_life_follow_the_boards_timeout_and_end_with_the_drive(
    virtual: VirtualBoard, other_host: OtherHost, is_set_before: bool
) -> None:
    with Board(virtual.tcp) as board:
        if is_set_before:
            other_host.send(PARAMETERS, *TIMEOUT_400_MS)
        board.motor[1].run(velocity=4000)
        if not is_set_before:
            board.settings["link timeout"] = 400
        time.sleep(1)
        assert board.motor[1].velocity == pytest.approx(4000, rel=0.1)
        assert board.faults == []
        board.motor[1].stop()
        frames = virtual.truth["link"]["frames_for_us"]
        time.sleep(0.5)
        assert virtual.truth["link"]["frames_for_us"] == frames


def test_stop_stops_everything(virtual: VirtualBoard, other_host: OtherHost) -> None:
    with Board(virtual.tcp) as board:
        other_host.send(VELOCITY, *MOTOR_2_RUNS)
        board.servo[6].pulse_us = 1500
        becomes(lambda: virtual.is_on(2), within=2)
        board.stop()
        assert not virtual.is_on(2) and not virtual.truth["servos"][5]["enabled"]


def test_another_hosts_motor_is_not_taken_over(virtual: VirtualBoard, other_host: OtherHost) -> None:
    with Board(virtual.tcp) as board:
        board.motor[1].run(duty=0.2)
        board.motor[1].stop()
        other_host.send(VELOCITY, *MOTOR_1_RUNS)
        becomes(lambda: virtual.is_on(1), within=2)
        with pytest.raises(Refused, match="motor 1 is driven already"):
            board.motor[1].run(velocity=100)
    assert virtual.is_on(1), "it is not this program's to stop"


def test_another_host_that_stops_the_motor_is_told(virtual: VirtualBoard, other_host: OtherHost) -> None:
    with Board(virtual.tcp) as board:
        board.motor[1].run(velocity=4000)
        board.wait(0.3)
        other_host.send(RUN, 0)
        with pytest.raises(BoardFault, match="motor 1 "):
            board.wait(3)
        board.wait(0.2)  # told once


@pytest.mark.parametrize("motor", [1, 2])
def test_another_host_that_takes_the_motor_or_starts_one_ends_the_drive(
    virtual: VirtualBoard, other_host: OtherHost, motor: int
) -> None:
    with Board(virtual.tcp) as board:
        board.motor[1].run(duty=0.3)
        board.wait(0.3)
        other_host.send(VELOCITY, motor - 1, 0xA0, 0x0F)
        with pytest.raises(BoardFault, match=f"another host drives motor {motor}"):
            board.wait(3)
        becomes(lambda: virtual.truth["motors"][0]["duty"] == 0, within=1)
    assert not virtual.is_on(1)
    assert virtual.is_on(2) == (motor == 2), "what is not this program's goes on"


def test_a_board_that_falls_silent_is_gone_and_the_stop_not_confirmed(
    virtual: VirtualBoard, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session, "_SILENCE", 1.0)
    monkeypatch.setattr(session, "_PATIENCE", 0.2)
    with pytest.raises(NotConfirmed, match="cut the motors' supply"):
        with Board(virtual.tcp) as board:
            board.motor[1].run(velocity=4000)
            board.wait(0.1)
            virtual.set(link=False)
            with pytest.raises(Gone, match="says nothing any more.*see that the board has power"):
                board.wait(4)
    becomes(lambda: not virtual.is_on(1), within=1)


def test_a_link_that_ends_is_gone_at_once(virtual: VirtualBoard) -> None:
    with Board(virtual.tcp) as board:
        virtual.kill()
        with pytest.raises(Gone, match="the link is gone"):
            board.wait(0.5)


def test_servos_move_hold_and_are_switched_off(virtual: VirtualBoard) -> None:
    with Board(virtual.tcp) as board:
        assert board.servo[2].pulse_us is None
        board.servo[2].pulse_us = 1500
        assert board.servo[2].pulse_us == pytest.approx(1500, abs=0.5)
        board.servo[2].move(2000, time=0.2)
        becomes(lambda: board.servo[2].pulse_us == 2000, within=3)
        board.servo[3].pulse_us = 1000
        board.servo[3].off()
    servos = virtual.truth["servos"]
    assert servos[1]["enabled"] and servos[1]["pulse_us"] == pytest.approx(2000, abs=1)
    assert not servos[2]["enabled"]


def test_what_is_out_of_range_names_the_range_and_moves_nothing(virtual: VirtualBoard) -> None:
    with Board(virtual.tcp) as board:
        with pytest.raises(OutOfRange, match="motor 1, velocity: 40000 is out of range, -32767 to 32767"):
            board.motor[1].run(velocity=40000)
        with pytest.raises(OutOfRange, match="-1 to 1"):
            board.motor[1].run(duty=float("nan"))
        with pytest.raises(OutOfRange, match="0 to 65.535"):
            board.motor[1].run(duty=0.1, time=66)
        with pytest.raises(OutOfRange, match="servo 1, in us: 100 is out of range, 223 to 3111"):
            board.servo[1].pulse_us = 100
        with pytest.raises(OutOfRange, match="motor 0: out of range, 1 to 6"):
            board.motor[0].stop()
        with pytest.raises(TypeError, match="one of velocity, position and duty"):
            board.motor[1].run(velocity=1, duty=1)
        assert board.motor[1].mode == "off"
