"""Links that are none, and links at whose other end is nobody."""

from __future__ import annotations

import socket

import pytest

from conftest import VirtualBoard, becomes
from handwheel import BadLink, Board, NoBoard, board


@pytest.mark.parametrize(
    "text",
    ["", "/dev/ttyUSB0", "tcp:", "tcp:5005", "tcp::5005", "udp:a:70000", "tcp:a:0", "serial:", "serial:x@", "usb:1"],
)
def test_what_is_no_link_is_answered_with_how_one_is_written(text: str) -> None:
    with pytest.raises(BadLink, match="write serial:/dev/ttyUSB0@115200, tcp:"):
        Board(text)


def test_a_line_too_slow_for_the_machine_state_is_refused() -> None:
    with pytest.raises(BadLink, match="19200 baud or more"):
        Board("serial:/dev/ttyUSB0@9600")


def test_where_nobody_listens_the_remedy_is_to_start_the_board() -> None:
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        with pytest.raises(NoBoard, match="nobody listens there; start the board"):
            Board(f"tcp:127.0.0.1:{unused.getsockname()[1]}")


def test_a_device_that_is_not_there() -> None:
    with pytest.raises(NoBoard, match="no such device"):
        Board("serial:/dev/no-such-device")


def test_a_line_on_which_nobody_speaks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(board, "_HEAR", 0.05)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        with pytest.raises(NoBoard, match="open, and nobody speaks"):
            Board(f"tcp:127.0.0.1:{silent.getsockname()[1]}")


def test_a_port_that_another_program_has(virtual: VirtualBoard) -> None:
    with Board(virtual.links["serial"]):
        with pytest.raises(NoBoard, match="another program has it"):
            Board(virtual.links["serial"])


def test_a_board_that_was_left_lets_go_of_its_link(virtual: VirtualBoard) -> None:
    for _ in range(3):
        with Board(virtual.tcp):
            pass
    becomes(lambda: virtual.truth["host"]["tcp"] == 0, within=1)
