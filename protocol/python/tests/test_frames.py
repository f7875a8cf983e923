"""Frames and the receiver, by the manual's own bytes."""

from __future__ import annotations

import random

import pytest

from handwheel.frame import ETX, STX, Frame, crc
from handwheel.receiver import Receiver

#: Section III and III.1 of the manual.
EXAMPLES = {
    "acknowledgement": ([94, 2, 0, 0, 255, 1, 1, 72, 94, 13], Frame(255, b"\x01", rid=0, res=0)),
    "III.1.1": ([94, 2, 1, 0, 28, 3, 2, 0, 8, 101, 94, 13], Frame(28, b"\x02\x00\x08", res=0)),
    "III.1.2": ([94, 2, 1, 0, 30, 2, 0, 7, 214, 94, 13], Frame(30, b"\x00\x07", res=0)),
    "III.1.3": ([94, 2, 1, 0, 5, 3, 4, 160, 15, 86, 94, 13], Frame(5, b"\x04\xa0\x0f", res=0)),
    "III.1.4": ([94, 2, 1, 0, 123, 1, 3, 197, 94, 13], Frame(123, b"\x03", res=0)),
    "III.1.5 sensor": ([94, 2, 1, 0, 7, 3, 13, 0, 2, 72, 94, 13], Frame(7, b"\x0d\x00\x02", res=0)),
    "III.1.5 method": ([94, 2, 1, 0, 7, 3, 14, 0, 1, 78, 94, 13], Frame(7, b"\x0e\x00\x01", res=0)),
    "III.1.5 position": ([94, 2, 1, 0, 3, 3, 0, 112, 23, 83, 94, 13], Frame(3, b"\x00\x70\x17", res=0)),
}

GOOD = Frame(255, b"\x00", rid=0, res=0)
MARKS = Frame(102, STX + ETX + b"\x5e" + STX, rid=0)


def figure_ii_1(data: bytes) -> int:
    """The C code of Figure II.1, transcribed."""
    shift_reg = 0
    for v in data:
        for _ in range(8):
            fb_bit = (v ^ shift_reg) & 1
            shift_reg >>= 1
            if fb_bit == 1:
                shift_reg ^= 0x8C
            v >>= 1
    return shift_reg


@pytest.mark.parametrize("example", EXAMPLES)
def test_the_manuals_examples_are_written_and_read_byte_by_byte(example: str) -> None:
    printed, frame = EXAMPLES[example]
    assert frame.encode() == bytes(printed)
    assert Receiver().receive(bytes(printed)) == [frame]


def test_the_checksum_is_that_of_figure_ii_1() -> None:
    data = bytes(range(256))
    for start in range(256):
        assert crc(data[start:]) == figure_ii_1(data[start:])


def test_data_may_hold_both_marks() -> None:
    assert Receiver().receive(MARKS.encode()) == [MARKS]


def test_a_good_frame_inside_a_damaged_one_is_found() -> None:
    damaged = bytearray(Frame(102, b"abc" + GOOD.encode() + b"def").encode())
    damaged[-3] ^= 1
    assert Receiver().receive(bytes(damaged)) == [GOOD]


def test_a_damaged_end_mark_is_no_frame() -> None:
    assert Receiver().receive(GOOD.encode()[:-1] + b"\x0e" + MARKS.encode()) == [MARKS]


def test_noise_that_announces_much_holds_up_only_until_the_line_is_silent() -> None:
    receiver = Receiver()
    assert receiver.receive(STX + b"\x00\x00\x00\xff" + GOOD.encode()) == []
    assert receiver.give_up() == [GOOD]
    assert receiver.receive(GOOD.encode()[:4]) == []
    assert receiver.give_up() == []
    assert receiver.receive(GOOD.encode()) == [GOOD]


def test_what_is_found_does_not_depend_on_the_pieces() -> None:
    rng = random.Random(5005)
    for _ in range(300):
        stream = b""
        for _ in range(12):
            frame = Frame(rng.randrange(256), bytes(rng.choices(STX + ETX + b"\x00a", k=rng.randrange(12)))).encode()
            if rng.random() < 0.4:
                at = rng.randrange(len(frame))
                frame = frame[:at] + bytes(rng.choices(STX + ETX + b"z", k=rng.randrange(3))) + frame[at + 1 :]
            stream += frame
        whole, cut = Receiver(), Receiver()
        pieces = []
        at = 0
        while at < len(stream):
            length = rng.randrange(1, 9)
            pieces += cut.receive(stream[at : at + length])
            at += length
        assert whole.receive(stream) == pieces
        assert whole.give_up() == cut.give_up()


def test_an_undamaged_stream_comes_whole() -> None:
    rng = random.Random(1)
    frames = [Frame(rng.randrange(256), rng.randbytes(rng.randrange(256))) for _ in range(100)]
    assert Receiver().receive(b"".join(frame.encode() for frame in frames)) == frames
