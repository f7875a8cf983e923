"""What moves something, and what stops it.

A motor that runs is kept running by signs of life until it is stopped. A motor that somebody else drives is not
taken over.
"""

from __future__ import annotations

from time import monotonic, sleep

from . import session as wire
from . import words
from .errors import BoardFault, Gone, NoAnswer, NotConfirmed, Refused, in_range
from .extension import COUNTS_PER_MS, FULL_DUTY, Channel, MachineState
from .session import Session
from .settings import link_timeout
from .watch import GRACE, Watch

_ALL = [1, 2, 3, 4, 5, 6]
_SUSPEND = b"\x00"
#: Servos stand behind the motors in a suspension.
_FIRST_SERVO = 6

#: How long a stop waits for the shaft, in s, and how often a stop of everything is repeated while another host
#: drives on.
_STAND = 1.0
_REPEATS = 3
#: A shaft stands when it has kept within so many counts, which is a potentiometer's noise, for so long.
_STILL_COUNTS = 5
_STILL = 0.15
_LOOK = 0.01

#: Targets and times on the wire.
_VELOCITY = 32_767
_POSITION = 32_767
_SERVO_COUNTS = (500, 7000)
_TIME = 65.535


class Motor:
    """A motor. What is measured comes from the machine state, and raises what `Board.check` raises."""

    def __init__(self, session: Session, watch: Watch, number: int) -> None:
        self._session = session
        self._watch = watch
        self.number = number

    def run(
        self,
        *,
        velocity: float | None = None,
        position: float | None = None,
        duty: float | None = None,
        time: float = 0,
    ) -> None:
        """Runs at a velocity (counts/s, -32767 to 32767), to a position (counts of its sensor, 0 to 32767; a
        potentiometer has 4096) or with a duty (-1 to 1 of full drive). Its set-point goes there in so many
        seconds, 65 at most. Returns when the board has taken the command; the motor is kept running until it is
        stopped.

        Raises `OutOfRange`; `Refused` if somebody else drives it; what `Board.check` raises.
        """
        self._watch.check()
        targets = {"velocity": velocity, "position": position, "PWM": duty}
        given = [(mode, value) for mode, value in targets.items() if value is not None]
        if len(given) != 1:
            raise TypeError("run: give one of velocity, position and duty")
        [(mode, value)] = given
        did, word = self._on_the_wire(mode, value)
        data = wire.target(self.number, word) + _time(time)
        if not self._watch.drives(self.number):
            self._must_be_off()
            self._session.sign_of_life = wire.sign_of_life(link_timeout(self._session))
        self._watch.begin(self.number, mode, did)
        try:
            # A stop from another thread ends it.
            self._session.command(did, data, "a motion command", lambda: self._watch.drives(self.number))
        except BaseException:
            self._watch.stopping([self.number])  # it may run: it is stopped at the end, and not kept alive
            raise
        self._watch.acknowledged(self.number, monotonic())

    def stop(self) -> None:
        """Stops it: no drive, and when its shaft stands (a second at most) its bridge is off.

        Raises `NotConfirmed`; `BoardFault` if another host drives it on.
        """
        stop(self._session, self._watch, [self.number])

    @property
    def velocity(self) -> int:
        """Counts of its sensor per second."""
        return self._channel().velocity

    @property
    def position(self) -> int:
        """Counts of its sensor since the board has started, turn by turn."""
        return self._channel().position

    @property
    def set_point(self) -> float:
        """What it is asked for at this moment of its move: counts, counts/s, or -1 to 1 of full drive."""
        return self._channel().set_point

    @property
    def duty(self) -> float:
        """What its bridge does, -1 to 1 of full drive."""
        return self._channel().duty

    @property
    def current(self) -> float:
        """In A."""
        return self._channel().current

    @property
    def mode(self) -> str:
        """What it is doing: "off", "PWM", "position" or "velocity"."""
        return self._channel().mode

    @property
    def reason(self) -> str | None:
        """Why it does not do what was asked, and what to do; None if it does."""
        return words.reason(self._channel())

    def _channel(self) -> Channel:
        state = self._session.state()
        self._watch.check()
        return state.channels[self.number - 1]

    def _on_the_wire(self, mode: str, value: float) -> tuple[int, int]:
        """DID and word of a target."""
        name = f"motor {self.number}, {mode}"
        if mode == "velocity":
            return wire.VELOCITY, round(in_range(name, value, -_VELOCITY, _VELOCITY))
        if mode == "position":
            return wire.POSITION, round(in_range(name, value, 0, _POSITION))
        word = FULL_DUTY + round(in_range(name, value, -1, 1) * FULL_DUTY)
        return wire.PWM, min(word, 2 * FULL_DUTY - 1)

    def _must_be_off(self) -> None:
        end = monotonic() + GRACE
        while self._session.state(age=0).channels[self.number - 1].mode != "off":
            if monotonic() >= end:
                raise Refused(
                    f"motor {self.number} is driven already: `board.stop()` first, or end the other host"
                )
            sleep(_LOOK)


class Servo:
    """A servo. It holds where it is, also when this program ends, until it is switched off."""

    def __init__(self, session: Session, watch: Watch, number: int) -> None:
        self._session = session
        self._watch = watch
        self.number = number

    @property
    def pulse_us(self) -> float | None:
        """Its pulse in microseconds, 223 to 3111; None while it is off. Set it to move the servo at once."""
        state = self._session.state()
        self._watch.check()
        counts = state.servos[self.number - 1]
        return counts * 1000 / COUNTS_PER_MS if counts else None

    @pulse_us.setter
    def pulse_us(self, pulse_us: float) -> None:
        self.move(pulse_us)

    def move(self, pulse_us: float, time: float = 0) -> None:
        """Moves it to a pulse in so many seconds, 65 at most.

        Raises `OutOfRange`; what `Board.check` raises.
        """
        self._watch.check()
        low, high = (counts * 1000 / COUNTS_PER_MS for counts in _SERVO_COUNTS)
        in_range(f"servo {self.number}, in us", pulse_us, -(-low // 1), high // 1)
        word = round(pulse_us * COUNTS_PER_MS / 1000)
        self._session.command(wire.SERVO, wire.target(self.number, word) + _time(time), "a servo")

    def off(self) -> None:
        """Switches its pulses off."""
        self._session.command(wire.RUN, _suspend(_FIRST_SERVO + self.number), "a stop")


def stop(session: Session, watch: Watch, motors: list[int]) -> None:
    """Stops these motors, waits until their shafts stand, a second at most, and sees that they are off.

    Raises `NotConfirmed`; `BoardFault` if another host drives on.
    """
    watch.stopping(motors)
    data = wire.neutral(*motors)
    try:
        session.say(wire.PWM, data)  # at once, whatever else is waited for
        session.command(wire.PWM, data, "a stop")
        _wait_until_they_stand(session, motors)
        for motor in motors:
            session.command(wire.RUN, _suspend(motor), "a stop")
        _see_that_they_are_off(session, motors)
    except (Gone, NoAnswer) as error:
        raise _not_confirmed(error) from error
    finally:
        watch.end(motors)


def stop_all(session: Session, watch: Watch) -> None:
    """Stops everything: motors and servos off at once, whoever drives them.

    Raises `NotConfirmed`; `BoardFault` if another host drives on.
    """
    watch.stopping(_ALL)
    try:
        for last in range(_REPEATS, 0, -1):
            session.say(wire.RUN, _SUSPEND)
            # Without a move that a resume would go on with.
            session.command(wire.PWM_ALL, _NEUTRAL_ALL, "a stop")
            session.command(wire.RUN, _SUSPEND, "a stop")
            _wait_until_they_stand(session, _ALL)
            try:
                return _see_that_they_are_off(session, _ALL, servos=True)
            except BoardFault:
                if last == 1:
                    raise
    except (Gone, NoAnswer) as error:
        raise _not_confirmed(error) from error
    finally:
        watch.end(_ALL)


_NEUTRAL_ALL = b"\x00\x40" * 6


def _wait_until_they_stand(session: Session, motors: list[int]) -> None:
    rest: dict[int, tuple[int, float]] = {}
    end = monotonic() + _STAND
    while monotonic() < end:
        state, now = session.state(), monotonic()
        for motor in motors:
            position = state.channels[motor - 1].position
            if motor not in rest or abs(position - rest[motor][0]) > _STILL_COUNTS:
                rest[motor] = (position, now)
        if all(now >= since + _STILL for _, since in rest.values()):
            return
        sleep(_LOOK)


def _see_that_they_are_off(session: Session, motors: list[int], servos: bool = False) -> None:
    end = monotonic() + GRACE
    while True:
        state = session.state()
        on = _on(state, motors, servos)
        if on is None:
            return
        if monotonic() >= end:
            raise BoardFault(f"{on} is on again after the stop: another host drives it; end that host")
        sleep(_LOOK)


def _on(state: MachineState, motors: list[int], servos: bool) -> str | None:
    """The first of them that is on."""
    for motor in motors:
        if state.channels[motor - 1].mode != "off":
            return f"motor {motor}"
    if servos:
        for servo, pulse in enumerate(state.servos, 1):
            if pulse:
                return f"servo {servo}"
    return None


def _not_confirmed(error: Exception) -> NotConfirmed:
    return NotConfirmed(f"the stop was sent and is NOT confirmed; cut the motors' supply: {error}")


def _suspend(number: int) -> bytes:
    """DATA that suspends one motor, or servo behind them."""
    return bytes((0, number - 1))


def _time(seconds: float) -> bytes:
    """What stands behind the targets of a motion command that takes time: a flag, and control periods of 1 ms."""
    periods = round(in_range("time in s", seconds, 0, _TIME) * 1000)
    return bytes((28,)) + periods.to_bytes(2, "little") if periods else b""
