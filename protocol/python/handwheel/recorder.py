"""The recorder: what motors did around a motion command or a fault, every control period if need be.

The board keeps the last recording until another is started. Asking for it keeps nothing running.
"""

from __future__ import annotations

import struct
from time import monotonic, sleep
from typing import Iterable, NamedTuple

from .errors import Error, Refused, in_range
from .extension import BLOCK, COUNTS_PER_AMPERE, FULL_DUTY, RECORDING, WITH_RECORDER, mode_of, set_point_of
from .frame import HOST, Frame
from .session import Session

TRIGGERS = ("now", "motion", "fault")
PHASES = ("none", "waiting", "recording", "done")

_START = struct.Struct("<BBHHH")
_STATE = struct.Struct("<BBBBHHHHIH")
_ROW = struct.Struct("<iihhHB")
_PORTION = struct.Struct("<HH")
_BLOCK = struct.Struct("<BH")
_ROWS_IN_A_BLOCK = 8
#: Blocks that are asked for at once.
_BLOCKS = 8
_LOOK = 0.05


class Recording(NamedTuple):
    """How the recorder is (DID 104)."""

    #: Rises with every recording, 0 if there was none since the board has started.
    serial: int
    #: One of `PHASES`.
    phase: str
    motors: tuple[int, ...]
    #: One of `TRIGGERS`.
    trigger: str
    #: Control periods (ms) between samples.
    every_ms: int
    #: Samples that were asked for, that were taken, and how many of these before the trigger.
    samples: int
    taken: int
    before: int
    #: Uptime of the board at the trigger.
    trigger_ms: int
    #: Rows (a sample of one motor each) that the board's memory holds.
    capacity: int


class Row(NamedTuple):
    """A sample of one motor."""

    #: Since the trigger; negative before it, and there up to `every_ms` - 1 too early, as the trigger's
    #: own period is sampled.
    time_ms: int
    motor: int
    #: Counts, and counts per second, of its sensor; where a motion command implies another one, they jump.
    position: int
    velocity: int
    #: By the mode: counts, counts per second, or -1 to 1 of full drive.
    set_point: float
    #: -1 to 1 of full drive.
    duty: float
    #: In A.
    current: float
    mode: str


class Recorder:
    """The board's recorder. All methods raise `Refused` if the board has none, `NoAnswer` and `Gone`."""

    def __init__(self, session: Session, extension: int) -> None:
        self._session = session
        self._extension = extension

    @property
    def is_there(self) -> bool:
        """Whether the board has one."""
        return self._extension >= WITH_RECORDER

    def start(
        self,
        motors: Iterable[int],
        *,
        samples: int,
        trigger: str = "motion",
        every_ms: int = 1,
        before: int = 0,
    ) -> Recording:
        """Starts a recording anew, of so many samples in all; more than fit are cut. It begins now, at a motion
        command that one of the motors carries out, or at a fault of one of them or of the board; then so many
        samples before that are kept.

        Raises `OutOfRange`.
        """
        channels = 0
        for motor in motors:
            channels |= 1 << int(in_range("motor", motor, 1, 6)) - 1
        if trigger not in TRIGGERS or not channels:
            raise Refused(f'a recording needs a motor, and a trigger out of {", ".join(TRIGGERS)}')
        in_range("samples", samples, 1, 65_535)
        in_range("every_ms", every_ms, 1, 65_535)
        in_range("samples before the trigger", before, 0, 0 if trigger == "now" else samples - 1)
        return self._ask(_START.pack(channels, TRIGGERS.index(trigger), every_ms, samples, before))

    @property
    def state(self) -> Recording:
        """How it is."""
        return self._ask(b"")

    def read(self, timeout: float = 10) -> list[Row]:
        """Waits until the recording is done, and returns it, sample by sample, within a sample motor by motor.

        Raises `Refused` if it is not done in so many seconds.
        """
        end = monotonic() + timeout
        while (recording := self.state).phase != "done":
            if recording.phase == "none":
                raise Refused("there is no recording: start one")
            if monotonic() >= end:
                raise Refused(f"the recording is still {recording.phase}: wait for longer, or move the motor")
            sleep(_LOOK)
        rows = recording.taken * len(recording.motors)
        count = -(-rows // _ROWS_IN_A_BLOCK)
        data = b""
        for first in range(0, count, _BLOCKS):
            blocks = self._blocks(recording.serial, first, min(_BLOCKS, count - first))
            data += b"".join(blocks[number] for number in sorted(blocks))
        if len(data) < rows * _ROW.size:
            raise Error("the board has told less of the recording than it has: report this")
        return [_row(recording, place, _ROW.unpack_from(data, place * _ROW.size)) for place in range(rows)]

    def _ask(self, data: bytes) -> Recording:
        if not self.is_there:
            raise Refused("this board's version has no recorder; bring its firmware up to date")
        return self._session.ask(RECORDING, data, _recording, "its recording")

    def _blocks(self, serial: int, first: int, count: int) -> dict[int, bytes]:
        """So many blocks, each whole; what gets lost is asked for again."""
        blocks: dict[int, bytes] = {}

        def answer(frame: Frame) -> dict[int, bytes] | None:
            if frame.rid == HOST and frame.did == BLOCK and len(frame.data) > _BLOCK.size:
                told, number = _BLOCK.unpack_from(frame.data)
                if told == serial and first <= number < first + count:
                    blocks[number] = frame.data[_BLOCK.size :]
            return blocks if len(blocks) == count else None

        return self._session.ask(BLOCK, _PORTION.pack(first, count), answer, "the recording's rows")


def _recording(frame: Frame) -> Recording | None:
    if frame.rid != HOST or frame.did != RECORDING or len(frame.data) < _STATE.size:
        return None
    serial, phase, channels, trigger, every_ms, *numbers = _STATE.unpack_from(frame.data)
    motors = tuple(motor for motor in range(1, 7) if channels >> (motor - 1) & 1)
    if phase >= len(PHASES) or trigger >= len(TRIGGERS):
        return None
    return Recording(serial, PHASES[phase], motors, TRIGGERS[trigger], every_ms, *numbers)


def _row(recording: Recording, place: int, row: tuple[int, ...]) -> Row:
    sample, channel = divmod(place, len(recording.motors))
    position, velocity, set_point, duty, current, number = row
    mode = mode_of(number)
    return Row(
        time_ms=(sample - recording.before) * recording.every_ms,
        motor=recording.motors[channel],
        position=position,
        velocity=velocity,
        set_point=set_point_of(set_point, mode),
        duty=duty / FULL_DUTY,
        current=current / COUNTS_PER_AMPERE,
        mode=mode,
    )
