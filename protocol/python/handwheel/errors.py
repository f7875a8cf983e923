"""What can go wrong: each is one line that says what is wrong and what to do."""

from __future__ import annotations


class Error(Exception):
    """All errors of this package."""


class BadLink(Error, ValueError):
    """The link is not written as one."""


class NoBoard(Error):
    """The link cannot be opened, or no board of ours is at its other end."""


class Gone(Error):
    """The link has ended, or the board says nothing any more."""


class NotConfirmed(Gone):
    """A stop was sent, and what came of it is not known."""


class NoAnswer(Error):
    """The board is there, and does not answer this."""


class Refused(Error):
    """The board refuses a request."""

    def __init__(self, line: str, setting: int = 0) -> None:
        super().__init__(line)
        #: The number of the setting that it is about, or 0.
        self.setting = setting


class OutOfRange(Error, ValueError):
    """A value, or a motor's or servo's number, is out of its range."""


class UnknownSetting(Error, KeyError):
    """No setting has this name."""

    __str__ = Exception.__str__  # a KeyError would put the line in quotes


class BoardFault(Error):
    """A motor does not do what this program has asked: a fault, a refusal, another host."""


def in_range(name: str, value: float, low: float, high: float) -> float:
    """The value, if it is in its range.

    Raises `OutOfRange`.
    """
    if not low <= value <= high:
        raise OutOfRange(f"{name}: {value:g} is out of range, {low:g} to {high:g}")
    return value
