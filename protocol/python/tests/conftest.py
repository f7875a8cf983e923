"""A virtual board for each test that wants one, with the simulated truth beside it."""

from __future__ import annotations

import json
import os
import queue
import re
import socket
import subprocess
import time
from pathlib import Path
from typing import Any, Callable, Iterable, Iterator

import pytest

from handwheel.frame import Frame
from handwheel.receiver import Receiver

_DEFAULT = Path(__file__).parent / "../../../target/release/virtual-board"
PROGRAM = os.environ.get("HANDWHEEL_VIRTUAL_BOARD", str(_DEFAULT))

#: What the board prints before it serves: name and address.
_PLACE = re.compile(r" +(serial device|TCP|UDP|inspect) ([^\s,]+)")


class VirtualBoard:
    """A board that was started, its links, and its truth."""

    def __init__(self) -> None:
        command = [PROGRAM, "--headless", "--seconds", "60", "--tcp", "127.0.0.1:0", "--udp", "127.0.0.1:0"]
        self.process = subprocess.Popen(
            [*command, "--inspect", "127.0.0.1:0"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        assert self.process.stdout is not None
        places: dict[str, str] = {}
        while "inspect" not in places:
            line = self.process.stdout.readline()
            assert line, "the virtual board has ended"
            if found := _PLACE.match(line):
                places[found[1]] = found[2]
        self.tcp = f"tcp:{places['TCP']}"
        self.links = {"tcp": self.tcp, "udp": f"udp:{places['UDP']}", "serial": f"serial:{places['serial device']}"}
        self._inspector = connect(f"tcp:{places['inspect']}").makefile("rw")

    def inspect(self, question: dict[str, Any]) -> Any:
        self._inspector.write(json.dumps(question) + "\n")
        self._inspector.flush()
        return json.loads(self._inspector.readline())

    @property
    def truth(self) -> Any:
        return self.inspect({"get": "state"})

    def set(self, **values: Any) -> None:
        self.inspect({"set": values})

    def is_on(self, motor: int) -> bool:
        return bool(self.truth["motors"][motor - 1]["enabled"])

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()


@pytest.fixture
def virtual() -> Iterator[VirtualBoard]:
    board = VirtualBoard()
    yield board
    board.kill()


def connect(link: str) -> socket.socket:
    """A plain TCP connection to a link."""
    _, host, port = link.split(":")
    return socket.create_connection((host, int(port)), 5)


class OtherHost:
    """A host of old: sends frames, and reads nothing."""

    def __init__(self, virtual: VirtualBoard) -> None:
        self._line = connect(virtual.tcp)

    def send(self, did: int, *data: int) -> None:
        self._line.sendall(Frame(did, bytes(data), res=0).encode())


@pytest.fixture
def other_host(virtual: VirtualBoard) -> OtherHost:
    return OtherHost(virtual)


class Line:
    """A link at whose other end is a function: what it answers to a frame comes at once."""

    def __init__(self, answer: Callable[[Frame], Iterable[Frame]]) -> None:
        self.written: list[Frame] = []
        self._answer = answer
        self._receiver = Receiver()
        self._coming: queue.Queue[Frame] = queue.Queue()

    def read(self) -> bytes:
        try:
            return self._coming.get(timeout=0.01).encode()
        except queue.Empty:
            return b""

    def write(self, frame: bytes) -> None:
        for written in self._receiver.receive(frame):
            self.written.append(written)
            self.tell(*self._answer(written))

    def tell(self, *frames: Frame) -> None:
        for frame in frames:
            self._coming.put(frame)

    def close(self) -> None:
        pass


def told(did: int, data: bytes) -> Frame:
    """A frame of the board's."""
    return Frame(did, data, rid=0)


def becomes(true: Callable[[], bool], within: float) -> float:
    """Waits until it is true, and returns how long that took."""
    begun = time.monotonic()
    while not true():
        assert time.monotonic() < begun + within, f"not so within {within} s"
        time.sleep(0.01)
    return time.monotonic() - begun
