"""Drives, watches and tunes a board of this project::

    from handwheel import Board
    with Board("tcp:127.0.0.1:5005") as board:
        board.motor[1].run(velocity=4000)
        board.wait(2)
        print(board.motor[1].velocity, board.sonar_cm, board.faults)

Motors and servos are 1 to 6, as in setting names and on the board's labels; the wire has 0 to 5.

- Only while it drives does a program send signs of life: who only asks keeps nothing running.
- What it drives it stops when the block is left, however that is. If the program itself is killed, the board stops
  it, 2 s after the last sign of life unless its settings say otherwise.
- Every error is one line that says what is wrong and what to do.
"""

from .board import Board
from .errors import (
    BadLink,
    BoardFault,
    Error,
    Gone,
    NoAnswer,
    NoBoard,
    NotConfirmed,
    OutOfRange,
    Refused,
    UnknownSetting,
)
from .extension import Setting
from .motion import Motor, Servo
from .recorder import Recording, Row
from .words import Fault

__all__ = [
    "BadLink",
    "Board",
    "BoardFault",
    "Error",
    "Fault",
    "Gone",
    "Motor",
    "NoAnswer",
    "NoBoard",
    "NotConfirmed",
    "OutOfRange",
    "Recording",
    "Refused",
    "Row",
    "Servo",
    "Setting",
    "UnknownSetting",
]
