"""Fills a spool until it is killed, and says what it has done: python spool_writer.py DIR SYNC.

Lines on standard output: `append N` once rows up to N are in it, `release N` before rows below N
are deleted from it.
"""

import random
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from support.spools.files import make, rows


def say(text: str) -> None:
    sys.stdout.write(f'{text}\n')
    sys.stdout.flush()


def main() -> None:
    chance = random.Random()  # noqa: S311 (sizes, no secrets)
    spool = make(Path(sys.argv[1]), sync=sys.argv[2] == 'sync')
    spool.open()
    say(f'open {spool.last}')
    while True:
        first = spool.last + 1
        last = first + chance.randrange(200)
        spool.append(rows(first, last, size=chance.choice([20, 300, 6000])))
        say(f'append {last}')
        if spool.count > 1000:
            before = spool.last - chance.randrange(800)
            say(f'release {before}')
            spool.delete_before(before)


main()
