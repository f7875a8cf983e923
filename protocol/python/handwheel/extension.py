"""The extension's bytes (Tables E.1 and E.2 of ``protocol/src/extension/mod.rs``): what can be asked, and
what is answered. Bytes behind those known here are a later version's, and are passed over.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from .frame import HOST, Frame

# Data IDs.
PARAMETERS = 7
SETTING = 96
IDENTITY = 97
FAULT = 100
OUTCOME = 101
STATE = 102
RECORDING = 104
BLOCK = 105

# Sub-commands of DID 7.
SET = 0x80
CLEAR_FAULTS = 0x81
SAVE = 0x82

# What came of a request.
DONE = 0
BUSY = 7

#: The version of the extension that brought the machine state, and the one that brought the recorder.
WITH_STATE = 2
WITH_RECORDER = 3

MODES = ("off", "PWM", "position", "velocity")
UNITS = (
    "", "0 no, 1 yes", "bits", "ms", "cm", "A/D counts", "counts", "counts/s", "1/16384 of full drive",
    "us", "s", "ticks",
)  # fmt: skip

#: Full drive on the wire, A/D counts to an ampere of motor current, a servo's counts to a millisecond of pulse.
FULL_DUTY = 16384
COUNTS_PER_AMPERE = 728
COUNTS_PER_MS = 2250

_IDENTITY = struct.Struct("<3BBBB")
_SETTING = struct.Struct("<HH4iB")
_ASSIGNMENT = struct.Struct("<BHi")
_FAULT = struct.Struct("<BBBBI3h")
_OUTCOME = struct.Struct("<BBBH")
_STATE = struct.Struct("<HBB3H")
_CHANNEL = struct.Struct("<iihhHBBB")
_SERVOS = struct.Struct("<6H")


class Identity(NamedTuple):
    """Who the board is (DID 97)."""

    #: Version of the firmware.
    version: tuple[int, int, int]
    #: Version of the extension.
    extension: int


class Setting(NamedTuple):
    """A setting, told in full (DID 96)."""

    number: int
    #: The next one's number, 0 behind the last.
    next: int
    name: str
    value: int
    low: int
    high: int
    default: int
    #: What the value counts; "" where the name says it.
    unit: str


class Outcome(NamedTuple):
    """What came of a request (DID 101)."""

    did: int
    #: The first byte of the request's DATA, 0 if it had none.
    first: int
    verdict: int
    #: The number of the setting that it is about, or 0.
    setting: int


class FaultRecord(NamedTuple):
    """A latched fault as it stands on the wire (DID 100)."""

    number: int
    #: Motor 1 to 6, None for the board.
    motor: int | None
    uptime_ms: int
    values: tuple[int, int, int]


class Channel(NamedTuple):
    """A motor in the machine state."""

    #: Counts of its sensor since boot, turn by turn.
    position: int
    #: Counts per second.
    velocity: int
    #: By the mode: counts, counts per second, or -1 to 1 of full drive.
    set_point: float
    #: -1 to 1 of full drive.
    duty: float
    #: In A.
    current: float
    #: One of `MODES`.
    mode: str
    #: Why it does not do what was asked, as a number, and more of it.
    reason: int
    detail: int


class MachineState(NamedTuple):
    """The board at one moment (DID 102)."""

    #: The low 16 bits of the uptime in ms.
    time_ms: int
    #: Whether the collision protection sees an obstacle.
    is_obstacle: bool
    #: Motors 1 to 6.
    channels: tuple[Channel, ...]
    #: Pulses of servos 1 to 6 in 1/2250 ms, 0 is none.
    servos: tuple[int, ...]


def assignment(number: int, value: int) -> bytes:
    """The sub-command that sets a setting."""
    return _ASSIGNMENT.pack(SET, number, value)


def identity(frame: Frame) -> Identity | None:
    """Reads an answer; None if it is another."""
    if not _is_answer(frame, IDENTITY, _IDENTITY):
        return None
    major, minor, patch, extension, _, _ = _IDENTITY.unpack_from(frame.data)
    return Identity((major, minor, patch), extension)


def setting(frame: Frame) -> Setting | None:
    """Reads an answer; None if it is another."""
    if not _is_answer(frame, SETTING, _SETTING):
        return None
    number, next_number, value, low, high, default, unit = _SETTING.unpack_from(frame.data)
    name = frame.data[_SETTING.size :].decode("ascii", "replace")
    return Setting(number, next_number, name, value, low, high, default, _named(UNITS, unit))


def fault(frame: Frame, place: int) -> tuple[FaultRecord | None] | None:
    """Reads the answer about this place of the list; None if it is another, (None,) behind the list's end."""
    data = frame.data
    if frame.rid != HOST or frame.did != FAULT or len(data) < 2 or data[0] != place:
        return None
    if place >= data[1]:
        return (None,)
    if len(data) < _FAULT.size:
        return None
    _, _, number, channel, uptime, *values = _FAULT.unpack_from(data)
    motor = channel + 1 if channel < 6 else None
    return (FaultRecord(number, motor, uptime, (values[0], values[1], values[2])),)


def outcome(frame: Frame, of: Frame) -> Outcome | None:
    """Reads what came of this request; None if the frame is about another."""
    if not _is_answer(frame, OUTCOME, _OUTCOME):
        return None
    told = Outcome(*_OUTCOME.unpack_from(frame.data))
    asked = (of.did, of.data[0] if of.data else 0)
    return told if (told.did, told.first) == asked else None


def state(frame: Frame) -> MachineState | None:
    """Reads a machine state; None if it is none."""
    if frame.rid != HOST or frame.did != STATE or len(frame.data) < 124:
        return None
    time_ms, flags, _, *_ = _STATE.unpack_from(frame.data)
    places = range(_STATE.size, _STATE.size + 6 * _CHANNEL.size, _CHANNEL.size)
    channels = tuple(_channel(*_CHANNEL.unpack_from(frame.data, at)) for at in places)
    servos = _SERVOS.unpack_from(frame.data, _STATE.size + 6 * _CHANNEL.size)
    return MachineState(time_ms, bool(flags & 2), channels, servos)


def _channel(
    position: int, velocity: int, set_point: int, duty: int, current: int, mode: int, reason: int, detail: int
) -> Channel:
    name = mode_of(mode)
    amperes = current / COUNTS_PER_AMPERE
    wanted = set_point_of(set_point, name)
    return Channel(position, velocity, wanted, duty / FULL_DUTY, amperes, name, reason, detail)


def mode_of(number: int) -> str:
    """What a motor is doing, in a word."""
    return _named(MODES, number)


def set_point_of(word: int, mode: str) -> float:
    """A set-point in people's units."""
    return word / FULL_DUTY if mode == "PWM" else word


def _is_answer(frame: Frame, did: int, form: struct.Struct) -> bool:
    return frame.rid == HOST and frame.did == did and len(frame.data) >= form.size


def _named(names: tuple[str, ...], number: int) -> str:
    return names[number] if number < len(names) else str(number)
