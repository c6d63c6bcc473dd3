"""A program that answers trials until its session is over and writes down each acknowledgement.

Arguments: the folder, and `durable` or `not`.
"""

import os
import sys
from pathlib import Path

from tactuator.experiment.store.store import Store
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, answer_one, begin, everything


def main() -> None:
    folder, clock = Path(sys.argv[1]), ObedientClock()
    acknowledged = os.open(folder / "acknowledged.txt", os.O_WRONLY | os.O_CREAT)
    store = Store(folder / "lab.db", durable=sys.argv[2] == "durable")
    store.mark(1)  # as a server does
    for subject in range(2 if sys.argv[2] == "durable" else 1):

        def answer(presented, clock, subject=subject) -> None:
            position, number = answer_one(presented, clock)
            os.write(acknowledged, f"{subject} {position} {number}\n".encode())
            os.fsync(acknowledged)

        everything(begin(store, clock, PROTOCOL, subject), clock, answer)
    store.mark(0)
    store.close()


main()
