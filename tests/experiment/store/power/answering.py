"""A program that answers trials until its session is over and writes down each acknowledgement.

Arguments: the folder, and `durable` or `not`.
"""

import os
import sys
from pathlib import Path

from tactuator.experiment.store.store import Store
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, answer_one, begin


def main() -> None:
    folder, clock = Path(sys.argv[1]), ObedientClock()
    acknowledged = os.open(folder / "acknowledged.txt", os.O_WRONLY | os.O_CREAT)
    store = Store(folder / "lab.db", durable=sys.argv[2] == "durable")
    for subject in range(2):
        presented = begin(store, clock, PROTOCOL, subject)
        while presented.session.stage != "done":
            if presented.session.stage == "break":
                clock.wait(100.0)
                presented.session.end_break()
            elif presented.session.stage == "introduction":
                presented.session.introduce()
            else:
                position, number = answer_one(presented, clock)
                os.write(acknowledged, f"{subject} {position} {number}\n".encode())
                os.fsync(acknowledged)
    store.close()


main()
