"""What is said on a line and when.

One background thread reads, keeps the newest of what was heard, and sends signs of life while something is
driven: never otherwise, and never to a board that says nothing any more. An *exchange* is something sent that
wants an answer; one is under way at a time, and it is sent again if it gets none.

All methods may be called from any thread.
"""

from __future__ import annotations

import threading
import time
from typing import Callable, TypeVar

from . import extension, reports, words
from .errors import Gone, NoAnswer, Refused
from .extension import MachineState, Outcome
from .frame import HOST, Frame
from .link import Link
from .receiver import Receiver
from .watch import Watch

T = TypeVar("T")

# Data IDs of Table II.1.
POSITION = 3
PWM = 5
PWM_ALL = 6
GPIO = 22
LCD = 23
VELOCITY = 26
SERVO = 28
RUN = 30
SETUP = 255

_PING = b"\x00"
_ACK = (SETUP, b"\x01")

#: How long an answer may take before the question is sent again, in s, and how often it is sent.
_PATIENCE = 0.5
_TRIES = 4
#: How long a board may be busy with something else.
_BUSY = 0.1
#: The longest and the shortest time between two signs of life.
SIGN_OF_LIFE = 0.5
_LEAST_SIGN_OF_LIFE = 0.01
#: A board that says nothing for so long is gone; it says something once a second.
_SILENCE = 2.5
#: A frame's bytes may pause for so long.
_PAUSE = 0.1
#: The machine state is asked for 255 times, and again after so long: the stream ends by itself.
_RENEW = 1.0
#: A machine state, and telemetry, that is older is waited for.
_FRESH = 0.1
#: A command takes 1.3 ms until it drives, and is acknowledged before: the first machine state behind may be older.
_BEHIND = 2
_FRESH_REPORT = 1.0
_TELEMETRY = 3.0

_PWM_NEUTRAL = 16384


class Session:
    """A host's end of a line."""

    def __init__(self, name: str, link: Link, watch: Watch) -> None:
        self.name = name
        #: Time between two signs of life.
        self.sign_of_life = SIGN_OF_LIFE
        self._link = link
        self._watch = watch
        self._writing = threading.RLock()
        self._exchanging = threading.RLock()
        #: Guards what the background thread has heard, and tells when it has heard more.
        self._news = threading.Condition()
        #: The newest of each kind, and when it came.
        self._newest: dict[type, tuple[float, object]] = {}
        #: The exchange under way.
        self._listener: Callable[[Frame], None] | None = None
        #: Why the link has ended.
        self._failure: str | None = None
        #: Bytes that have come so far.
        self.received = 0
        #: When a frame of a board came last, and when any bytes did.
        self._heard = float("-inf")
        self._came = time.monotonic()
        #: Machine states so far, and which of them is the first that knows of the last command.
        self._states = 0
        self._first_state = 0
        #: When the last sign of life was sent, and when states are to be asked for again.
        self._lived = float("-inf")
        self._renew_due = 0.0
        self._is_closing = False
        self._thread = threading.Thread(target=self._run, name=f"handwheel {name}", daemon=True)
        self._thread.start()

    @property
    def has_heard(self) -> bool:
        """Whether a board has said anything."""
        return self._heard > float("-inf")

    @property
    def is_open(self) -> bool:
        """Whether the link has not ended."""
        return self._failure is None

    def close(self) -> None:
        """Ends the thread and closes the link."""
        self._is_closing = True
        self._thread.join()
        self._link.close()

    def say(self, did: int, data: bytes = b"") -> None:
        """Sends a frame that wants no acknowledgement.

        Raises `Gone`.
        """
        self._write(Frame(did, data))

    def command(self, did: int, data: bytes, what: str, go_on: Callable[[], bool] = lambda: True) -> None:
        """Sends a command and waits until it is acknowledged; it is sent again as long as `go_on` says.

        Raises `NoAnswer`, `Gone`.
        """

        def acknowledged(frame: Frame) -> bool | None:
            return frame[:2] == _ACK or None

        self._exchange(Frame(did, data, res=0), acknowledged, what, go_on=go_on)
        self._first_state = self._states + _BEHIND

    def ask(
        self,
        did: int,
        data: bytes,
        answer: Callable[[Frame], T | None],
        what: str,
        tries: int = _TRIES,
        patience: float | None = None,
    ) -> T:
        """Sends a request and returns its answer: the first that `answer` reads from a frame.

        Raises `Refused`, `NoAnswer`, `Gone`.
        """
        found = self._exchange(Frame(did, data), answer, what, tries, patience)
        if not found:
            raise NoAnswer(f"the board has nothing to tell when asked for {what}: bring its firmware up to date")
        return found[0]

    def order(self, data: bytes, what: str, tries: int = _TRIES, patience: float | None = None) -> None:
        """Sends a request of DID 7, and waits until it is done.

        Raises `Refused`, `NoAnswer`, `Gone`.
        """
        self._exchange(Frame(extension.PARAMETERS, data), lambda _: None, what, tries, patience)
        self._first_state = self._states + _BEHIND

    def state(self, age: float = _FRESH) -> MachineState:
        """The machine state: it knows of the last command, and is no older than so many s.

        Raises `NoAnswer`, `Gone`.
        """
        asked = time.monotonic()

        def look() -> MachineState | None:
            return self._newer(MachineState, asked - age) if self._states >= self._first_state else None

        while time.monotonic() < asked + _TRIES * _PATIENCE:
            self._ask_for_states(time.monotonic())
            state = self._await(look, _FRESH)
            if state is not None:
                return state
            self._renew_due = 0.0  # another host may have ended the stream
        raise self._unanswered('its machine state (see the setting "machine state period")', asked)

    def report(self, kind: type[T]) -> T:
        """The newest telemetry of a kind, no older than a second; waits for it, as asking would be a sign of
        life.

        Raises `NoAnswer`, `Gone`.
        """
        now = time.monotonic()
        report = self._await(lambda: self._newer(kind, now - _FRESH_REPORT), _TELEMETRY)
        if report is None:
            raise self._unanswered("telemetry, which another host may have switched off", now)
        return report

    def _newer(self, kind: type[T], oldest: float) -> T | None:
        at, value = self._newest.get(kind, (0.0, None))
        return value if isinstance(value, kind) and at >= oldest else None

    def _exchange(
        self,
        request: Frame,
        answer: Callable[[Frame], T | None],
        what: str,
        tries: int = _TRIES,
        patience: float | None = None,
        go_on: Callable[[], bool] = lambda: True,
    ) -> list[T]:
        """Returns what was answered, or nothing if the board just says that it is done."""
        answers: list[T] = []
        outcomes: list[Outcome] = []

        def listen(frame: Frame) -> None:
            told = answer(frame)
            outcome = extension.outcome(frame, request)
            if told is not None:
                answers.append(told)
            elif outcome is not None:
                outcomes.append(outcome)

        with self._exchanging:
            asked = time.monotonic()
            before, self._listener = self._listener, listen
            try:
                for _ in range(tries):
                    if not go_on():
                        break
                    outcomes.clear()
                    self._write(request)
                    self._await(lambda: True if answers or outcomes else None, patience or _PATIENCE)
                    if answers or outcomes and outcomes[0].verdict == extension.DONE:
                        return answers
                    if outcomes and outcomes[0].verdict == extension.BUSY:
                        time.sleep(_BUSY)
                    elif outcomes:
                        why = words.verdict(outcomes[0].verdict)
                        raise Refused(f"the board refuses: {why}", outcomes[0].setting)
            finally:
                self._listener = before
        raise self._unanswered(what, asked)

    def _await(self, look: Callable[[], T | None], patience: float) -> T | None:
        """Waits for what `look` finds; None if it does not come in time."""
        end = time.monotonic() + patience
        with self._news:
            while True:
                found = look()
                if found is not None:
                    return found
                if self._failure is not None:
                    raise Gone(self._failure)
                left = end - time.monotonic()
                if left <= 0:
                    return None
                self._news.wait(left)

    def _unanswered(self, what: str, asked: float) -> Gone | NoAnswer:
        if self._heard < asked:
            return Gone(self._gone("the board says nothing any more"))
        return NoAnswer(
            f"the board does not answer when asked for {what}; its firmware may know no such request, or the "
            "line is bad"
        )

    def _gone(self, why: object) -> str:
        return f"{self.name}: the link is gone ({why}); see that the board has power and is connected"

    def _write(self, frame: Frame) -> None:
        with self._writing:
            if self._is_closing:
                raise Gone(f"{self.name}: the link was closed by this program; open the board again")
            try:
                self._link.write(frame.encode())
            except OSError as error:
                raise Gone(self._gone(error)) from error

    def _ask_for_states(self, now: float) -> None:
        if now >= self._renew_due:
            self._renew_due = now + _RENEW
            self.say(extension.STATE, b"\xff")

    # The background thread.

    def _run(self) -> None:
        receiver = Receiver()
        try:
            while not self._is_closing:
                data = self._link.read()
                now = time.monotonic()
                if data:
                    self._came = now
                    self.received += len(data)
                is_silent = now > self._came + _PAUSE
                for frame in receiver.give_up() if is_silent else receiver.receive(data):
                    self._hear(frame, now)
                self._keep_alive(now)
        except (OSError, Gone) as error:
            why = str(error) if isinstance(error, Gone) else self._gone(error)
            with self._news:
                self._failure = why
                self._news.notify_all()

    def _hear(self, frame: Frame, now: float) -> None:
        if frame.rid != HOST:
            return
        told = extension.state(frame) or reports.parse(frame)
        if isinstance(told, MachineState):
            for motor in self._watch.see(told, now):
                self.say(PWM, neutral(motor))
        with self._news:
            self._heard = now
            self._states += isinstance(told, MachineState)
            if told is not None:
                self._newest[type(told)] = (now, told)
            if self._listener is not None:
                self._listener(frame)
            self._news.notify_all()

    def _keep_alive(self, now: float) -> None:
        is_due = now >= self._lived + self.sign_of_life
        if is_due and self._watch.is_driving and now < self._heard + _SILENCE:
            self._lived = now
            self.say(SETUP, _PING)
            self._ask_for_states(now)


def sign_of_life(link_timeout_ms: int) -> float:
    """How often a sign of life is due, in s: four times in the silence that the board allows; 0 is any."""
    if link_timeout_ms == 0:
        return SIGN_OF_LIFE
    return min(SIGN_OF_LIFE, max(_LEAST_SIGN_OF_LIFE, link_timeout_ms / 4000))


def neutral(*motors: int) -> bytes:
    """DATA of a PWM command that stops these motors."""
    return b"".join(target(motor, _PWM_NEUTRAL) for motor in motors)


def target(number: int, word: int) -> bytes:
    """A motor's or servo's target in the list of a motion command. People count from 1, the wire from 0."""
    return bytes((number - 1,)) + (word & 0xFFFF).to_bytes(2, "little")
