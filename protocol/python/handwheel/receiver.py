"""The resynchronising receiver: bytes in, whole frames out.

A *candidate* is a place in the stream that begins like a frame. Once as many bytes are there as its LEN
announces, it is a frame, or it is rejected; then the search goes on at its second byte, so that a good frame
inside a bad one is found. The frames found do not depend on how the stream was cut into pieces.
"""

from __future__ import annotations

from .frame import ETX, HEADER, OVERHEAD, STX, Frame, crc


class Receiver:
    """Finds frames in a stream of bytes."""

    def __init__(self) -> None:
        #: What no decision has been made about.
        self._pending = bytearray()

    def receive(self, data: bytes) -> list[Frame]:
        """Takes bytes, and returns the frames that are complete."""
        self._pending += data
        return self._find(is_silent=False)

    def give_up(self) -> list[Frame]:
        """Rejects every candidate that waits for more bytes, as the line has been silent for too long.

        Returns the good frames that they held up.
        """
        return self._find(is_silent=True)

    def _find(self, is_silent: bool) -> list[Frame]:
        frames = []
        pending = self._pending
        while pending:
            begins = STX.startswith(bytes(pending[:2]))
            length = pending[HEADER - 1] + OVERHEAD if len(pending) >= HEADER else HEADER
            if begins and len(pending) < length:
                if not is_silent:
                    break
                self._reject()
            elif begins and _is_intact(pending, length):
                rid, res, did = pending[2:5]
                frames.append(Frame(did, bytes(pending[HEADER : length - 3]), rid, res))
                del pending[:length]
            else:
                self._reject()
        return frames

    def _reject(self) -> None:
        """Skips the first byte, and what follows up to the next that could begin a frame."""
        place = self._pending.find(STX[0], 1)
        del self._pending[: place if place > 0 else len(self._pending)]


def _is_intact(pending: bytearray, length: int) -> bool:
    body, checksum = bytes(pending[2 : length - 3]), pending[length - 3]
    return pending[length - 2 : length] == ETX and crc(body) == checksum
