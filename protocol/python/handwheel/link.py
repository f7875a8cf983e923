"""The ways to a board: ``serial:/dev/ttyUSB0@115200``, ``tcp:127.0.0.1:5005``, ``udp:127.0.0.1:10001``."""

from __future__ import annotations

import select
import socket
from typing import Protocol

import serial
from serial.tools import list_ports

from .errors import BadLink, NoBoard

#: The baud rate of a serial link that names none, and the least that carries the machine state.
DEFAULT_BAUD = 115_200
LEAST_BAUD = 16_000

#: How long a read waits, in s: nothing is later than that.
TICK = 0.01
#: How long a connection may take to be made, or a write to be taken, in s.
PATIENCE = 3.0


class Link(Protocol):
    """An open line to a board. All methods raise OSError when it is gone. One thread reads; any may write,
    one at a time."""

    def read(self) -> bytes:
        """What has come; waits for a `TICK` at most, and then returns nothing."""

    def write(self, frame: bytes) -> None:
        """Writes a whole frame, which is one datagram on UDP."""

    def close(self) -> None:
        """Closes it."""


def open_link(text: str) -> Link:
    """Opens a link.

    Raises `BadLink`, and `NoBoard` when it cannot be opened.
    """
    kind, _, rest = text.partition(":")
    if kind == "serial":
        device, _, baud = rest.partition("@")
        if device and (baud.isdecimal() or "@" not in rest):
            return _open_serial(text, device, int(baud or DEFAULT_BAUD))
    elif kind in ("tcp", "udp"):
        host, _, port = rest.rpartition(":")
        if host and port.isdecimal() and 0 < int(port) < 65_536:
            host = host.strip("[]")
            return _open_socket(text, host, int(port), is_tcp=kind == "tcp")
    raise BadLink(
        f"{text!r}: not a link; write serial:/dev/ttyUSB0@115200, tcp:127.0.0.1:5005 or udp:127.0.0.1:10001"
    )


def _open_serial(text: str, device: str, baud: int) -> Link:
    if baud < LEAST_BAUD:
        raise BadLink(f"{text}: too slow for the machine state; use 19200 baud or more")
    try:
        port = serial.Serial(device, baud, timeout=TICK, write_timeout=PATIENCE, exclusive=True)
    except (OSError, ValueError) as error:
        raise NoBoard(f"{device}: {_remedy(device, error)}") from error
    return _Serial(port)


def _remedy(device: str, error: Exception) -> str:
    if isinstance(error, serial.SerialException) and "exclusively lock" in str(error):
        return "another program has it; end that program first"
    number = getattr(error, "errno", None)
    if number == 13:
        return "no permission; join the group that owns it (`sudo usermod -aG dialout $USER`) and log in again"
    if number == 2:
        ports = ", ".join(sorted(port.device for port in list_ports.comports()))
        return f"no such device; {f'there are {ports}' if ports else 'this computer has no serial ports'}"
    return f"{error}; see that it is a serial device, and the baud rate one of its own"


def _open_socket(text: str, host: str, port: int, is_tcp: bool) -> Link:
    try:
        if is_tcp:
            stream = socket.create_connection((host, port), PATIENCE)
            stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return _Tcp(stream)
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        datagrams = socket.socket(family, socket.SOCK_DGRAM)
        datagrams.settimeout(PATIENCE)
        datagrams.connect(address)
        return _Udp(datagrams)
    except ConnectionRefusedError as error:
        raise NoBoard(
            f"{text}: nobody listens there; start the board (a virtual one: `cargo run --release -p hal-mock`), "
            "or see that the port is right"
        ) from error
    except OSError as error:
        raise NoBoard(f"{text}: {error}; see that the board is on, and that the address is right") from error


class _Serial:
    def __init__(self, port: serial.Serial) -> None:
        self._port = port

    def read(self) -> bytes:
        return bytes(self._port.read(max(1, self._port.in_waiting)))

    def write(self, frame: bytes) -> None:
        self._port.write(frame)

    def close(self) -> None:
        self._port.close()


class _Tcp:
    def __init__(self, stream: socket.socket) -> None:
        self._socket = stream

    def read(self) -> bytes:
        if not select.select([self._socket], [], [], TICK)[0]:
            return b""
        data = self._socket.recv(4096)
        if not data:
            raise ConnectionError("the other side has closed it")
        return data

    def write(self, frame: bytes) -> None:
        self._socket.sendall(frame)

    def close(self) -> None:
        self._socket.close()


class _Udp:
    def __init__(self, datagrams: socket.socket) -> None:
        self._socket = datagrams

    def read(self) -> bytes:
        if not select.select([self._socket], [], [], TICK)[0]:
            return b""
        return self._socket.recv(65_535)

    def write(self, frame: bytes) -> None:
        self._socket.send(frame)

    def close(self) -> None:
        self._socket.close()
