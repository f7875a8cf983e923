"""What the board tells, from bytes written by hand; and what an image becomes."""

from __future__ import annotations

import struct

import pytest

from conftest import told
from handwheel import OutOfRange, extension, reports, words
from handwheel.board import _parts
from handwheel.frame import Frame


def test_sensors_come_in_peoples_units() -> None:
    data = bytes([30, 255, 10, 20, 40, 50])
    data += struct.pack("<4H", 2047, 2048, 2049, 2050)
    data += struct.pack("<6H", 2048 + 625, 2048, 980, 980 + 116, 1256 + 870, 1678)
    data += bytes([1, 2, 3, 255]) + struct.pack("<5H", 4095, 2048, 1365, 3413, 2048)
    sensors = reports.parse(told(125, data))
    assert isinstance(sensors, reports.Sensors)
    assert sensors.sonar_cm == (30, 255, 10, 20, 40, 50)
    assert sensors.human == (2047, 2048, 2049, 2050)
    assert sensors.tilt_degrees == pytest.approx((30, 0))
    assert sensors.driver_c == pytest.approx((100, 90))
    assert sensors.temperature_c == pytest.approx(25)
    assert sensors.infrared_cm == pytest.approx(20, abs=0.02)
    assert sensors.infrared_key == bytes([1, 2, 3])
    assert sensors.battery_v == pytest.approx((9, 12.003, 3), abs=0.01)
    assert sensors.reference_v == pytest.approx((5, 3), abs=0.01)


def test_infrared_beyond_its_range_is_its_end() -> None:
    for value, centimetres in ((0, 80), (4095, 10)):
        data = bytes(24) + struct.pack("<H", value) + bytes(14)
        sensors = reports.parse(told(125, data))
        assert isinstance(sensors, reports.Sensors) and sensors.infrared_cm == centimetres
        assert sensors.infrared_key is None


def test_potentiometers_have_their_angle() -> None:
    motors = reports.parse(told(123, struct.pack("<16HB", 0, 4095, *[2048] * 14, 3)))
    assert isinstance(motors, reports.Motors)
    degrees = [reports.potentiometer_degrees(value) for value in motors.potentiometers]
    assert degrees == pytest.approx([13.46, 346.46, 180, 180, 180, 180], abs=0.01)


def test_inputs_and_custom_channels() -> None:
    custom = reports.parse(told(124, struct.pack("<8HB", 4095, *[0] * 7, 0b1000_0001)))
    assert isinstance(custom, reports.CustomIo)
    assert custom.custom_v[:2] == (3, 0)
    assert custom.inputs == (True, *[False] * 6, True)


def state() -> bytes:
    channel = struct.pack("<iihhHBBB", -70_000, -400, 8192, -8192, 728, 1, 1, 2)
    return struct.pack("<HBB3H", 7, 2, 0, 0, 0, 0) + channel + bytes(85) + struct.pack("<6H", 3375, *[0] * 5)


def test_a_machine_state_is_read() -> None:
    machine = extension.state(told(102, state() + b"later version"))
    assert machine is not None and machine.is_obstacle and machine.servos[0] == 3375
    motor = machine.channels[0]
    assert motor[:6] == (-70_000, -400, 0.5, -0.5, 1.0, "PWM")
    assert words.reason(motor) == (
        "fault 2, stall: the shaft was held fast while it was driven: free it; then `board.clear_faults()`"
    )
    assert words.reason(machine.channels[1]) is None


def test_what_is_too_short_or_another_hosts_is_no_answer() -> None:
    for length in range(124):
        assert extension.state(told(102, state()[:length])) is None
        assert reports.parse(told(125, bytes(length % 40))) is None
    assert extension.state(Frame(102, state())) is None
    assert extension.identity(told(97, b"\x00\x01")) is None
    assert extension.setting(told(96, bytes(20))) is None
    assert extension.fault(told(100, b"\x00\x01\x02"), 0) is None


def test_a_fault_is_told_with_its_values_and_its_remedy() -> None:
    record = extension.fault(told(100, struct.pack("<BBBBI3h", 0, 1, 2, 0, 5000, 900, 16384, -3)), 0)
    assert record is not None and record[0] is not None
    fault = words.fault(record[0])
    assert (fault.name, fault.motor, fault.uptime_ms) == ("stall", 1, 5000)
    assert fault.values == {"current (A/D)": 900, "duty (1/16384)": 16384, "position (counts)": -3}
    assert str(fault) == "stall of motor 1: the shaft was held fast while it was driven: free it"
    assert extension.fault(told(100, b"\x01\x01"), 1) == (None,)


def test_a_pixel_is_where_the_wire_has_it() -> None:
    image = [[0] * 128 for _ in range(64)]
    image[0][0] = image[9][65] = 1
    parts = list(_parts(image))
    assert len(parts) == 16
    assert (parts[0][0], parts[3][1]) == (1, 2)
    assert sum(map(sum, parts)) == 3
    with pytest.raises(OutOfRange, match="64 rows of 128"):
        list(_parts(image[1:]))
