"""Runs motor 1 at 4000 counts a second for two seconds, prints what is measured, and stops it.

    python drive.py [LINK]        tcp:127.0.0.1:5005, the virtual board's, unless another is given
"""

import sys

from handwheel import Board, Error


def main(link: str) -> None:
    with Board(link) as board:
        print("firmware", ".".join(map(str, board.identity.version)))
        for fault in board.faults:
            print(fault)

        motor = board.motor[1]
        motor.run(velocity=4000, time=0.5)
        for _ in range(10):
            board.wait(0.2)
            print(f"count {motor.position:6}, {motor.velocity:5} counts/s, {motor.current:.2f} A, {motor.reason or 'runs'}")
        motor.stop()

        print("ranges in cm", board.sonar_cm)
        print(f"motors' battery {board.battery_v.motors:.1f} V")
        print("telemetry period", board.settings["telemetry period"], "ms")


if __name__ == "__main__":
    try:
        main(sys.argv[1] if len(sys.argv) > 1 else "tcp:127.0.0.1:5005")
    except Error as error:
        sys.exit(f"drive: {error}")
