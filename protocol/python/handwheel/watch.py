"""What this program drives, and whether it still does what was asked.

Signs of life keep everything on a board running, whoever drives it. So every machine state is looked at: a
motor of ours that is off, refuses, or is another host's is driven no longer, nor is any when another host
starts a motor of its own. The `BoardFault` that says so is kept for the program's next access.

Called from the program's threads and from the session's: all methods may be called from any.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass

from . import words
from .errors import BoardFault
from .extension import Channel, MachineState

#: What a board tells may be older than the command, by so many s.
GRACE = 0.15


@dataclass
class _Drive:
    """A motor that was asked to run."""

    mode: str
    #: The command's DID, as a refusal names it.
    command: int
    #: When the command was acknowledged.
    since: float = float("inf")
    #: It is being stopped, and keeps nothing alive.
    is_stopping: bool = False


class Watch:
    """The motors that this program drives, 1 to 6."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._drives: dict[int, _Drive] = {}
        #: The motors that were on in the last machine state.
        self._on: set[int] = set()
        self._fault: BoardFault | None = None

    @property
    def is_driving(self) -> bool:
        """Whether signs of life are due."""
        with self._lock:
            return any(not drive.is_stopping for drive in self._drives.values())

    @property
    def motors(self) -> list[int]:
        """The motors that are to be stopped at the end."""
        with self._lock:
            return sorted(self._drives)

    def drives(self, motor: int) -> bool:
        """Whether this motor is driven."""
        with self._lock:
            return motor in self._drives and not self._drives[motor].is_stopping

    def begin(self, motor: int, mode: str, command: int) -> None:
        """This motor may run from now on."""
        with self._lock:
            self._drives[motor] = _Drive(mode, command)

    def acknowledged(self, motor: int, now: float) -> None:
        """The board has taken the command."""
        with self._lock:
            if motor in self._drives:
                self._drives[motor].since = now

    def stopping(self, motors: list[int]) -> None:
        """These are being stopped."""
        with self._lock:
            for motor in motors:
                if motor in self._drives:
                    self._drives[motor].is_stopping = True

    def end(self, motors: list[int]) -> None:
        """These are driven no longer."""
        with self._lock:
            for motor in motors:
                self._drives.pop(motor, None)

    def see(self, state: MachineState, now: float) -> list[int]:
        """Looks at a new machine state, and returns the motors that are to be stopped."""
        with self._lock:
            on = {motor for motor, channel in enumerate(state.channels, 1) if channel.mode != "off"}
            new = on - self._on - self._drives.keys()
            self._on = on
            lost = []
            for motor, drive in list(self._drives.items()):
                channel = state.channels[motor - 1]
                line = _trouble(motor, drive, channel, new) if now >= drive.since + GRACE else None
                if line is None:
                    continue
                self._fault = self._fault or BoardFault(line)
                if channel.mode == "off":
                    del self._drives[motor]
                else:
                    drive.is_stopping = True
                    lost.append(motor)
            return lost

    def check(self) -> None:
        """Raises the `BoardFault` that has come since the last call, if one has."""
        with self._lock:
            fault, self._fault = self._fault, None
        if fault is not None:
            raise fault


def _trouble(motor: int, drive: _Drive, channel: Channel, new: set[int]) -> str | None:
    """Why this motor does not run as it was asked; None if it does. One that is being stopped may still have had a
    fault."""
    if drive.is_stopping and (channel.mode != "off" or channel.reason != words.FAULT):
        return None
    is_refused = channel.reason in words.REFUSED and channel.detail == drive.command
    if channel.mode == "off" or is_refused:
        why = words.reason(channel) or "another host has stopped it: end that host"
        return f"motor {motor} does not run: {why}"
    if channel.mode != drive.mode:
        return (
            f"another host drives motor {motor}: its mode is {channel.mode}, not {drive.mode}; "
            "the motor is stopped: end that host"
        )
    if new:
        return (
            f"another host drives motor {min(new)} now, which this program would keep running if that host "
            f"died; motor {motor} is stopped: let one host drive both"
        )
    return None
