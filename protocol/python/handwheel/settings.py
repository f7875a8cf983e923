"""Settings by name, as a mapping."""

from __future__ import annotations

import difflib
from typing import Iterator, Mapping

from . import extension
from .errors import Refused, UnknownSetting, in_range
from .extension import Setting
from .frame import Frame
from .session import Session, sign_of_life

#: The silence of its host that the board allows, in ms.
LINK_TIMEOUT = "link timeout"
_LINK_TIMEOUT = 1
#: Settings that a frame holds; the board takes them in one control period, all or none.
_MOST = 36


class Settings(Mapping[str, int]):
    """The board's settings: ``settings["velocity Kp 1"] = 120``. What is set is in force at once, and forgotten
    at the board's next start unless it is saved.

    Raises `UnknownSetting`, `OutOfRange`, both before anything is sent; `Refused`, `NoAnswer`, `Gone`.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        #: Those that were read so far, by name; what changes is their values.
        self._known: dict[str, Setting] = {}
        #: The number of the one behind them, None behind the last.
        self._next: int | None = 0

    def __getitem__(self, name: str) -> int:
        return self.about(name).value

    def __setitem__(self, name: str, value: int) -> None:
        self.update({name: value})

    def __iter__(self) -> Iterator[str]:
        self._read_all()
        return iter(self._known)

    def __len__(self) -> int:
        self._read_all()
        return len(self._known)

    def about(self, name: str) -> Setting:
        """A setting in full: value, range, default, unit."""
        return _numbered(self._session, self._find(name).number)

    def update(self, values: Mapping[str, int]) -> None:
        """Sets several, 36 at most: all of them or none, in one control period, as some depend on each other."""
        in_range("settings in one update", len(values), 1, _MOST)
        data = b""
        for name, value in values.items():
            setting = self._find(name)
            in_range(setting.name, value, setting.low, setting.high)
            data += extension.assignment(setting.number, value)
        try:
            self._session.order(data, "setting settings")
        except Refused as refused:
            names = [name for name in values if self._known[name].number == refused.setting]
            raise Refused(f"{names[0]}: {refused}" if names else str(refused), refused.setting) from None
        if LINK_TIMEOUT in values:
            self._session.sign_of_life = sign_of_life(values[LINK_TIMEOUT])

    def _find(self, name: str) -> Setting:
        while name not in self._known and self._read_next():
            pass
        if name in self._known:
            return self._known[name]
        nearest = difflib.get_close_matches(name, self._known, 1, 0.4)
        hint = f'did you mean "{nearest[0]}"?' if nearest else "`list(board.settings)` has them"
        raise UnknownSetting(f'no setting is called "{name}"; {hint}')

    def _read_all(self) -> None:
        while self._read_next():
            pass

    def _read_next(self) -> bool:
        """Whether there is another, which is known then."""
        if self._next is None:
            return False
        setting = _numbered(self._session, self._next)
        self._known[setting.name] = setting
        # A list that does not rise would have no end.
        self._next = setting.next if setting.next > setting.number else None
        return True


def link_timeout(session: Session) -> int:
    """The silence of its host that the board allows, in ms; 0 is any."""
    return _numbered(session, _LINK_TIMEOUT).value


def _numbered(session: Session, number: int) -> Setting:
    """The setting of this number; of 0, the first."""

    def answer(frame: Frame) -> Setting | None:
        setting = extension.setting(frame)
        return setting if setting is not None and number in (0, setting.number) else None

    return session.ask(extension.SETTING, number.to_bytes(2, "little"), answer, "settings")
