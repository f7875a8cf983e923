"""Faults, reasons and refusals for people, each with the remedy. The texts are those of the tool `handwheel`."""

from __future__ import annotations

from typing import NamedTuple

from .extension import Channel, FaultRecord

_CHANNEL_VALUES = ("current (A/D)", "duty (1/16384)", "position (counts)")

#: By number: name, remedy, and the names of the values that are told with it.
_FAULTS: dict[int, tuple[str, str, tuple[str, ...]]] = {
    1: (
        "over current",
        "the motor drew too much for 2 s: a jam, a short, or too small a bridge",
        _CHANNEL_VALUES,
    ),
    2: ("stall", "the shaft was held fast while it was driven: free it", _CHANNEL_VALUES),
    3: (
        "tracking error",
        "the shaft went the wrong way or the loop hunted: see the polarity, the sensor's wires, and Kp",
        ("error (counts, or counts/s)", "duty (1/16384)", "position (counts)"),
    ),
    4: (
        "sensor lost",
        "driven, and the sensor saw nothing: see its plug, its wires, and which sensor is set",
        ("position (counts)", "duty (1/16384)", "last good position (counts)"),
    ),
    5: ("overload", "too much current for too long: less load, or pauses", _CHANNEL_VALUES),
    6: (
        "current sensor",
        'a current where none can be: see the sensor, or set "current sensor" of the channel to 0',
        ("current (A/D)",),
    ),
    16: ("motor battery low", "charge the motors' battery", ("battery (A/D)",)),
    17: ("motor battery high", "see the motors' supply", ("battery (A/D)",)),
    18: ("servo battery low", "charge the servos' battery", ("battery (A/D)",)),
    19: ("main battery low", "charge the board's battery", ("battery (A/D)",)),
    20: (
        "driver too hot",
        "let the motor drivers cool, and give them air",
        ("driver 1 (A/D)", "driver 2 (A/D)"),
    ),
    21: ("ambient too hot", "let it cool", ("temperature (A/D)",)),
    22: (
        "link loss",
        "on record only: the host fell silent, and what moved was stopped; so does every host that ends",
        ("silence (ms)",),
    ),
    23: ("control period missed", "the board has too much to do: report it", ("latency (us)",)),
    24: ("receive overrun", "bytes were lost: see the baud rate", ()),
    25: (
        "settings corrupt",
        "what was stored was damaged, and the defaults are in force: set yours again, and save",
        (),
    ),
    26: ("watchdog reset", "the program had hung and was restarted: report it", ()),
}

#: The reason that a fault is latched; the detail is its number.
FAULT = 1
_REASONS = {
    2: "the host fell silent",
    3: "suspended",
    4: "command {} refused: the channel's \"method\" is set to another",
    5: "command {} refused: the target is beyond the sensor's scale",
    6: "an obstacle is in the way",
    7: "held at a soft limit",
    8: "the current is too high: the drive is limited",
    9: "the current was too high for too long: the drive is limited",
    10: "its slew time limits the drive",
    11: "its highest duty limits the drive",
    12: "it has all the drive there is, and that is not enough: held fast, or too weak",
    13: 'its last motion command grew too old (setting "oldest command"; 0 allows any age)',
}

#: Reasons by which a motion command was refused; the detail is the command's DID.
REFUSED = (4, 5)

_VERDICTS = {
    1: "this board's version has no such request; bring its firmware up to date",
    2: "the request has the wrong length",
    3: "no setting has this number",
    4: "a value is out of its range",
    5: "the value contradicts another setting's; set both with `settings.update`, or the other one first",
    6: "a motor or a servo is on that must be off; `board.stop()` does that",
    7: "another request is being carried out, or another host's is: wait for its answer",
    8: "this board cannot do it",
    9: "the flash failed; what was saved before is still there",
}


class Fault(NamedTuple):
    """A latched fault, with what to check."""

    name: str
    #: What to check.
    remedy: str
    #: Motor 1 to 6, None for the board.
    motor: int | None
    #: Uptime in ms when it tripped.
    uptime_ms: int
    #: What was true then, by name and unit.
    values: dict[str, int]

    def __str__(self) -> str:
        whose = "the board" if self.motor is None else f"motor {self.motor}"
        return f"{self.name} of {whose}: {self.remedy}"


def fault(record: FaultRecord) -> Fault:
    """A fault from the wire in words."""
    name, remedy, values = _explained(record.number)
    return Fault(name, remedy, record.motor, record.uptime_ms, dict(zip(values, record.values)))


def reason(channel: Channel) -> str | None:
    """Why a motor does not do what was asked; None if it does."""
    if channel.reason == 0:
        return None
    if channel.reason == FAULT:
        name, remedy, _ = _explained(channel.detail)
        return f"fault {channel.detail}, {name}: {remedy}; then `board.clear_faults()`"
    return _REASONS.get(channel.reason, f"reason {channel.reason}").format(channel.detail)


def verdict(number: int) -> str:
    """Why a board refuses, and what to do."""
    return _VERDICTS.get(number, f"verdict {number}")


def _explained(number: int) -> tuple[str, str, tuple[str, ...]]:
    return _FAULTS.get(number, (f"fault {number}", "see the firmware's documentation", ()))
