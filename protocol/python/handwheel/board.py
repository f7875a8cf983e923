"""A board behind a link: what a program uses.

**What is raised, and when.** Everything raises `Gone` when the link has ended or the board says nothing any more.
When a motor that this program drives is switched off by a fault, refuses, or is taken by another host, a
`BoardFault` with the remedy is raised once: by the next thing that is asked of a motor, a servo or a sensor, by
`check` and `wait`, or else on leaving the block; a tenth of a second after it has happened, at the latest. `stop`, `faults`, `clear_faults`, settings and the recorder never
raise it, so that a program can see to it.

**Threads.** A board may be used from several threads; questions wait for each other, a stop for nothing. Signs of
life come from a thread of the board's own, so a motor goes on while the program sleeps, and also while it hangs: set
"oldest command" where that must stop it.
"""

from __future__ import annotations

from time import monotonic, sleep
from types import TracebackType
from typing import Generic, Iterator, Sequence, TypeVar

from . import extension, motion, reports, words
from . import session as wire
from .errors import Error, Gone, NoAnswer, NoBoard, OutOfRange, Refused, in_range
from .extension import WITH_STATE, Identity
from .link import open_link
from .motion import Motor, Servo
from .recorder import Recorder
from .reports import Batteries, CustomIo, Motors, References, Sensors
from .session import Session
from .settings import Settings
from .watch import Watch
from .words import Fault

T = TypeVar("T")

#: A board that is there says something within this time, in s; it is asked who it is so often.
_HEAR_TRIES = 8
_HEAR = 0.3
#: The flash of a board takes up to 3 s for a save.
_SAVE = 5.0
_LOOK = 0.05

_COLUMNS, _ROWS = 128, 64
_PART_COLUMNS, _PART_ROWS = 64, 8


class Six(Generic[T]):
    """Six of a kind, 1 to 6 as people count."""

    def __init__(self, name: str, members: Sequence[T]) -> None:
        self._name = name
        self._members = members

    def __getitem__(self, number: int) -> T:
        if number not in range(1, 7):
            raise OutOfRange(f"{self._name} {number}: out of range, 1 to 6")
        return self._members[number - 1]

    def __iter__(self) -> Iterator[T]:
        return iter(self._members)


class Board:
    """A board. Use it in a ``with`` block: leaving it stops what the program drove."""

    def __init__(self, link: str) -> None:
        """Opens a link (``serial:/dev/ttyUSB0``, ``tcp:127.0.0.1:5005``, ``udp:127.0.0.1:10001``) and finds out who
        is there. Moves nothing, and keeps nothing running.

        Raises `BadLink`, `NoBoard`.
        """
        self._watch = Watch()
        self._session = Session(link, open_link(link), self._watch)
        try:
            self.identity = self._find_out()
        except BaseException:
            self._session.close()
            raise
        self.settings = Settings(self._session)
        self.motor = Six("motor", [Motor(self._session, self._watch, number) for number in range(1, 7)])
        self.servo = Six("servo", [Servo(self._session, self._watch, number) for number in range(1, 7)])
        self.recorder = Recorder(self._session, self.identity.extension)

    def __enter__(self) -> Board:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
        if error is None:
            self._watch.check()

    def close(self) -> None:
        """Stops what this program drives, sees that it is off, and closes the link.

        Raises `NotConfirmed`; `BoardFault` if another host drives on.
        """
        try:
            motors = self._watch.motors
            if motors:
                motion.stop(self._session, self._watch, motors)
        finally:
            self._session.close()

    def stop(self) -> None:
        """Stops everything at once: motors and servos off, whoever drives them.

        Raises `NotConfirmed`; `BoardFault` if another host drives on.
        """
        motion.stop_all(self._session, self._watch)

    def check(self) -> None:
        """Looks whether the motors that this program drives still do what was asked.

        Raises `BoardFault` if one does not, `Gone`.
        """
        self._session.state()
        self._watch.check()

    def wait(self, seconds: float) -> None:
        """Sleeps, and checks all the while."""
        end = monotonic() + seconds
        self.check()
        while (left := end - monotonic()) > 0:
            sleep(min(left, _LOOK))
            self.check()

    # Faults and settings.

    @property
    def faults(self) -> list[Fault]:
        """The faults on record, 16 at the most, each with its remedy."""
        faults: list[Fault] = []
        while True:
            place = len(faults)
            (record,) = self._session.ask(
                extension.FAULT, bytes((place,)), lambda frame: extension.fault(frame, place), "its faults"
            )
            if record is None:
                return faults
            faults.append(words.fault(record))

    def clear_faults(self) -> None:
        """Clears the latched faults, but for those of the board whose cause is still there. Moves nothing."""
        self._session.order(bytes((extension.CLEAR_FAULTS,)), "a clearing of its faults")

    def save(self) -> None:
        """Saves the settings that are in force; only with all motors and servos off.

        Raises `Refused`.
        """
        self._session.order(bytes((extension.SAVE,)), "a save of its settings", tries=2, patience=_SAVE)

    # What is measured.

    @property
    def potentiometers(self) -> tuple[int, ...]:
        """The six potentiometers, A/D values 0 to 4095."""
        return self._report(Motors).potentiometers

    @property
    def potentiometer_degrees(self) -> tuple[float, ...]:
        """The six potentiometers in degrees, 180 in the middle."""
        return tuple(map(reports.potentiometer_degrees, self.potentiometers))

    @property
    def sonar_cm(self) -> tuple[int, ...]:
        """Six ultrasonic ranges in cm; 255 is nothing in range."""
        return self._report(Sensors).sonar_cm

    @property
    def infrared_cm(self) -> float:
        """Infrared range in cm, 10 to 80."""
        return self._report(Sensors).infrared_cm

    @property
    def infrared_key(self) -> bytes | None:
        """The three bytes of the remote control's key, None while no key is held."""
        return self._report(Sensors).infrared_key

    @property
    def human(self) -> tuple[int, ...]:
        """Human sensors, A/D values: alarm 1, motion 1, alarm 2, motion 2; some 2047 at rest."""
        return self._report(Sensors).human

    @property
    def tilt_degrees(self) -> tuple[float, float]:
        """Tilt along the X and the Y axis."""
        return self._report(Sensors).tilt_degrees

    @property
    def temperature_c(self) -> float:
        """The surroundings in degrees Celsius."""
        return self._report(Sensors).temperature_c

    @property
    def driver_c(self) -> tuple[float, float]:
        """The two motor driver boards in degrees Celsius."""
        return self._report(Sensors).driver_c

    @property
    def battery_v(self) -> Batteries:
        """The batteries of the board, the motors and the servos in V."""
        return self._report(Sensors).battery_v

    @property
    def reference_v(self) -> References:
        """Vcc, and the reference of the potentiometers, in V."""
        return self._report(Sensors).reference_v

    @property
    def custom_v(self) -> tuple[float, ...]:
        """The eight custom A/D channels in V."""
        return self._report(CustomIo).custom_v

    @property
    def inputs(self) -> tuple[bool, ...]:
        """The eight inputs, input 0 first."""
        return self._report(CustomIo).inputs

    @property
    def is_obstacle(self) -> bool:
        """Whether the collision protection sees an obstacle."""
        state = self._session.state()
        self._watch.check()
        return state.is_obstacle

    def _report(self, kind: type[T]) -> T:
        report = self._session.report(kind)
        self._watch.check()
        return report

    # What is shown.

    def set_outputs(self, levels: int) -> None:
        """Sets the eight outputs; bit 0 is output 0."""
        self._watch.check()
        level = int(in_range("outputs", levels, 0, 255))
        self._session.command(wire.GPIO, bytes((level,)), "outputs")

    def lcd(self, image: Sequence[Sequence[int]]) -> None:
        """Shows an image: 64 rows of 128 pixels, 0 or 1.

        Raises `OutOfRange`.
        """
        self._watch.check()
        for number, part in enumerate(_parts(image)):
            self._session.command(wire.LCD, bytes((number,)) + part, "an image")

    # Who is there.

    def _find_out(self) -> Identity:
        session = self._session
        try:
            identity = session.ask(
                extension.IDENTITY, b"", extension.identity, "who it is", tries=_HEAR_TRIES, patience=_HEAR
            )
        except (NoAnswer, Refused, Gone) as error:
            raise NoBoard(self._nobody(error)) from error
        if identity.extension < WITH_STATE:
            raise NoBoard(f"{session.name}: the board's firmware is too old to tell its state; bring it up to date")
        return identity

    def _nobody(self, error: Error) -> str:
        session = self._session
        if session.has_heard:
            return f"{session.name}: a PMS5005 without our firmware, which this package needs: no extension answers"
        if session.received:
            return (
                f"{session.name}: {session.received} bytes came and none is of a board we know; see the baud rate, "
                "and that this is the right device"
            )
        if session.is_open:
            return (
                f"{session.name}: open, and nobody speaks; see that the board has power, and TX and RX are not "
                "swapped"
            )
        return str(error)


def _parts(image: Sequence[Sequence[int]]) -> Iterator[bytes]:
    """The sixteen parts of an image as the wire has them: even ones are the left half, odd ones the right, from
    the top; a byte is a column of 8 pixels, the least significant bit on top."""
    if len(image) != _ROWS or any(len(row) != _COLUMNS for row in image):
        raise OutOfRange(f"an image has {_ROWS} rows of {_COLUMNS} pixels; this one has another size")
    for top in range(0, _ROWS, _PART_ROWS):
        for left in range(0, _COLUMNS, _PART_COLUMNS):
            yield bytes(
                sum(bool(image[top + row][column]) << row for row in range(_PART_ROWS))
                for column in range(left, left + _PART_COLUMNS)
            )
