"""The frame: ``5E 02 | RID | RES | DID | LEN | DATA[LEN] | CRC | 5E 0D`` (manual, section II).

There is no byte stuffing: DATA may hold both marks, so the length rules, never a search for the end mark.
"""

from __future__ import annotations

from typing import NamedTuple

STX = b"\x5e\x02"
ETX = b"\x5e\x0d"

#: Bytes up to LEN, and bytes of a frame that are not DATA.
HEADER = 6
OVERHEAD = 9

#: RID of the host and of the board.
HOST = 0
BOARD = 1

#: RES of a frame that wants no acknowledgement.
NO_ACK = 255


def _remainder(register: int) -> int:
    for _ in range(8):
        register = (register >> 1) ^ (0x8C if register & 1 else 0)
    return register


_REMAINDERS = bytes(_remainder(byte) for byte in range(256))


def crc(data: bytes) -> int:
    """The checksum over RID to DATA: CRC-8/MAXIM, as the code of Figure II.1."""
    register = 0
    for byte in data:
        register = _REMAINDERS[register ^ byte]
    return register


class Frame(NamedTuple):
    """A frame's fields. What DATA means is the business of `reports` and `extension`."""

    did: int
    data: bytes = b""
    rid: int = BOARD
    res: int = NO_ACK

    def encode(self) -> bytes:
        """The whole frame. DATA has 255 bytes at most."""
        body = bytes((self.rid, self.res, self.did, len(self.data))) + self.data
        return STX + body + bytes((crc(body),)) + ETX
