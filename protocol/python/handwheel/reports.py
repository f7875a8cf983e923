"""What the board tells unasked: the telemetry of Tables II.2, II.3 and II.4, in people's units.

A/D values have 12 bits. Where a sensor has a documented scale its value is in that unit; the others are A/D
values, 0 to 4095.
"""

from __future__ import annotations

import math
import struct
from typing import NamedTuple

from .frame import HOST, Frame

MOTORS = 123
CUSTOM_IO = 124
SENSORS = 125

_MOTORS = struct.Struct("<6H6H4HB")
_CUSTOM_IO = struct.Struct("<8HB")
_SENSORS = struct.Struct("<6B4H2H2HHH4s3H2H")

AD_MAX = 4095


class Motors(NamedTuple):
    """Motor control signals (DID 123). Motors themselves are told by the machine state."""

    #: A/D values of the six potentiometers.
    potentiometers: tuple[int, ...]


class CustomIo(NamedTuple):
    """Custom inputs (DID 124)."""

    #: The eight custom A/D channels in V.
    custom_v: tuple[float, ...]
    #: The eight inputs, input 0 first.
    inputs: tuple[bool, ...]


class Batteries(NamedTuple):
    """Of the board, the motors and the servos, in V."""

    board: float
    motors: float
    servos: float


class References(NamedTuple):
    """Reference voltages: Vcc, and that of the potentiometers, in V."""

    vcc: float
    vref: float


class Sensors(NamedTuple):
    """Sensors (DID 125)."""

    #: Six ultrasonic ranges in cm; 255 is nothing in range.
    sonar_cm: tuple[int, ...]
    #: Human sensors, A/D: alarm 1, motion 1, alarm 2, motion 2; some 2047 at rest.
    human: tuple[int, ...]
    #: Tilt in degrees: X axis, Y axis.
    tilt_degrees: tuple[float, float]
    #: The two motor driver boards in degrees Celsius.
    driver_c: tuple[float, float]
    #: The surroundings in degrees Celsius.
    temperature_c: float
    #: Infrared range in cm, 10 to 80.
    infrared_cm: float
    #: The three bytes of the remote control's key, None while no key is held.
    infrared_key: bytes | None
    battery_v: Batteries
    reference_v: References


def parse(frame: Frame) -> Motors | CustomIo | Sensors | None:
    """Reads a frame; None if it is no telemetry."""
    if frame.rid != HOST:
        return None
    did, data = frame.did, frame.data
    if did == MOTORS and len(data) == _MOTORS.size:
        return Motors(_MOTORS.unpack(data)[:6])
    if did == CUSTOM_IO and len(data) == _CUSTOM_IO.size:
        *custom, inputs = _CUSTOM_IO.unpack(data)
        volts = tuple(_volts(3, value) for value in custom)
        return CustomIo(volts, tuple(bool(inputs >> bit & 1) for bit in range(8)))
    if did == SENSORS and len(data) == _SENSORS.size:
        values = _SENSORS.unpack(data)
        key, held = values[16][:3], values[16][3]
        return Sensors(
            sonar_cm=values[:6],
            human=values[6:10],
            tilt_degrees=(_tilt(values[10]), _tilt(values[11])),
            driver_c=(_overheat(values[12]), _overheat(values[13])),
            temperature_c=(values[14] - 1256) / 34.8,
            infrared_cm=_infrared(values[15]),
            infrared_key=key if held == 255 else None,
            battery_v=Batteries(_volts(9, values[17]), _volts(24, values[18]), _volts(9, values[19])),
            reference_v=References(_volts(6, values[20]), _volts(6, values[21])),
        )
    return None


def potentiometer_degrees(value: int) -> float:
    """The angle of a potentiometer: 333 degrees from 0 to 4095, 180 in the middle."""
    return (value - 2048) / AD_MAX * 333 + 180


def _volts(full_scale: int, value: int) -> float:
    return full_scale * value / AD_MAX


def _tilt(value: int) -> float:
    return math.degrees(math.asin(max(-1.0, min(1.0, (value - 2048) / 1250))))


def _overheat(value: int) -> float:
    return 100 - (value - 980) / 11.6


def _infrared(value: int) -> float:
    volts = 3 * value / 4028 - 0.17
    return max(10.0, min(80.0, 21.6 / volts)) if volts > 0 else 80.0
