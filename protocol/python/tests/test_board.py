"""Faults, settings, sensors and what is shown."""

from __future__ import annotations

import threading
import time

import pytest

from conftest import VirtualBoard, becomes
from handwheel import Board, BoardFault, OutOfRange, Refused, UnknownSetting


def test_a_stall_is_raised_once_with_its_remedy_and_can_be_cleared(virtual: VirtualBoard) -> None:
    with Board(virtual.tcp) as board:
        board.settings["stall time"] = 300
        virtual.set(jam=[True, *[False] * 5])
        board.motor[1].run(duty=0.6)
        with pytest.raises(BoardFault, match="motor 1 does not run: fault 2, stall: .*: free it; then"):
            board.wait(5)
        assert board.motor[1].mode == "off"
        assert board.motor[1].reason is not None and "stall" in board.motor[1].reason
        [fault] = board.faults
        assert (fault.name, fault.motor) == ("stall", 1) and "free it" in fault.remedy
        assert abs(fault.values["duty (1/16384)"] - 0.6 * 16384) < 1000
        virtual.set(jam=None)
        board.clear_faults()
        assert board.faults == [] and board.motor[1].reason is None
        board.motor[1].run(duty=0.2)
        board.wait(0.3)
        assert board.motor[1].mode == "PWM"


def test_a_fault_that_nobody_looked_at_is_raised_by_the_next_access(virtual: VirtualBoard) -> None:
    with Board(virtual.tcp) as board:
        board.settings["stall time"] = 300
        virtual.set(jam=[True, *[False] * 5])
        board.motor[1].run(duty=0.6)
        becomes(lambda: not virtual.is_on(1), within=5)
        time.sleep(0.1)
        with pytest.raises(BoardFault, match="stall"):
            print(board.sonar_cm)
        print(board.sonar_cm)


def test_a_fault_that_nobody_asked_about_is_raised_on_leaving(virtual: VirtualBoard) -> None:
    with pytest.raises(BoardFault, match="stall"):
        with Board(virtual.tcp) as board:
            board.settings["stall time"] = 300
            virtual.set(jam=[True, *[False] * 5])
            board.motor[1].run(duty=0.6)
            becomes(lambda: bool(board.faults), within=5)


def test_a_refused_command_is_a_fault_with_its_remedy(virtual: VirtualBoard) -> None:
    with Board(virtual.tcp) as board:
        board.settings["method 1"] = 2
        board.motor[1].run(velocity=100)
        with pytest.raises(BoardFault, match='"method" is set to another'):
            board.wait(3)


def test_settings_by_name(virtual: VirtualBoard) -> None:
    with Board(virtual.tcp) as board:
        assert board.settings["velocity Kp 1"] == 50
        board.settings["velocity Kp 1"] = 120
        assert board.settings["velocity Kp 1"] == 120
        about = board.settings.about("telemetry period")
        assert (about.value, about.low, about.high, about.default, about.unit) == (50, 1, 60000, 50, "ms")
        with pytest.raises(OutOfRange, match="velocity Kp 1: 70000 is out of range, 0 to 65535"):
            board.settings["velocity Kp 1"] = 70000
        with pytest.raises(UnknownSetting, match='^no setting is called "velocity Kp"; did you mean "velocity K'):
            board.settings["velocity Kp"] = 1
        assert "velocity Kp 7" not in board.settings
        names = list(board.settings)
        assert len(names) == len(board.settings) > 100 and names[0] == "link timeout"


def test_settings_that_depend_on_each_other_go_together(virtual: VirtualBoard) -> None:
    with Board(virtual.tcp) as board:
        with pytest.raises(Refused, match="sonar clear: the board refuses: the value contradicts another setting's; set both with"):
            board.settings["sonar clear"] = 20
        board.settings.update({"sonar stop": 10, "sonar clear": 20})
        assert (board.settings["sonar stop"], board.settings["sonar clear"]) == (10, 20)


def test_a_save_wants_everything_off(virtual: VirtualBoard) -> None:
    with Board(virtual.tcp) as board:
        board.motor[1].run(velocity=1000)
        with pytest.raises(Refused, match=r"must be off; `board.stop\(\)` does that"):
            board.save()
        board.stop()
        board.save()


def test_sensors(virtual: VirtualBoard) -> None:
    with Board(virtual.tcp) as board:
        virtual.set(sonar_cm=[20, 30, 255, 255, 255, 255], gpio_in=5, ir_command=[1, 2, 3, 255], pot=[0, *[None] * 5])
        becomes(lambda: board.sonar_cm == (20, 30, 255, 255, 255, 255), within=3)
        becomes(lambda: board.inputs == (True, False, True, *[False] * 5), within=3)
        becomes(lambda: board.potentiometers[0] == 0, within=3)
        assert board.infrared_key == bytes([1, 2, 3])
        assert board.potentiometer_degrees[0] == pytest.approx(13.5, abs=0.1)
        assert board.battery_v.motors == pytest.approx(12, abs=0.2)
        assert 10 < board.temperature_c < 40 and all(10 < celsius < 60 for celsius in board.driver_c)
        assert board.tilt_degrees == pytest.approx((0, 0), abs=1)
        assert board.reference_v.vcc == pytest.approx(5, abs=0.1)
        assert 10 <= board.infrared_cm <= 80 and len(board.human) == 4 and len(board.custom_v) == 8
        assert not board.is_obstacle


def test_outputs_and_the_lcd_show_what_they_are_given(virtual: VirtualBoard) -> None:
    image = [[0] * 128 for _ in range(64)]
    image[0][0] = image[9][65] = image[63][127] = 1
    with Board(virtual.tcp) as board:
        board.set_outputs(0b1010_0001)
        board.lcd(image)
        becomes(lambda: virtual.truth["gpio_out"] == 0b1010_0001, within=1)
        becomes(lambda: bool(int(virtual.truth["lcd"], 16)), within=1)
        lcd = bytes.fromhex(virtual.truth["lcd"])
        lit = {(row, column) for row in range(64) for column in range(128) if lcd[row // 8 * 128 + column] >> row % 8 & 1}
        assert lit == {(0, 0), (9, 65), (63, 127)}


def test_threads_may_share_a_board(virtual: VirtualBoard) -> None:
    errors: list[Exception] = []

    def ask(board: Board, name: str) -> None:
        try:
            for _ in range(20):
                assert board.settings.about(name).name == name
                assert board.motor[1].mode in ("off", "velocity", "PWM")
        except Exception as error:  # told below
            errors.append(error)

    with Board(virtual.tcp) as board:
        names = ("link timeout", "Ki reading", "full speed encoder")
        threads = [threading.Thread(target=ask, args=(board, name)) for name in names]
        for thread in threads:
            thread.start()
        board.motor[1].run(velocity=1000)
        board.stop()
        for thread in threads:
            thread.join()
    assert errors == []
