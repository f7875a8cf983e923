"""Records how motor 1 answers a step to 4000 counts a second, every control period, and writes it as CSV.

    python record.py [LINK] > step.csv
"""

import csv
import sys

from handwheel import Board, Error, Row


def main(link: str) -> None:
    with Board(link) as board:
        board.settings["sensor 1"] = 3  # the encoder, from before the step on
        board.recorder.start([1], samples=400, before=50)
        board.motor[1].run(velocity=4000)
        rows = board.recorder.read()
    table = csv.writer(sys.stdout)
    table.writerow(Row._fields)
    table.writerows(rows)


if __name__ == "__main__":
    try:
        main(sys.argv[1] if len(sys.argv) > 1 else "tcp:127.0.0.1:5005")
    except Error as error:
        sys.exit(f"record: {error}")
