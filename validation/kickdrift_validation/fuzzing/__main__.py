"""Repeat cases, one by one or in a row, and show the rules that they break.

python -m kickdrift_validation.fuzzing KIND NUMBER [COUNT] [--seed S] [--files FOLDER]
"""

import argparse
import sys
from collections import defaultdict
from pathlib import Path
from time import monotonic

from kickdrift_validation.fuzzing.kinds import KINDS
from kickdrift_validation.fuzzing.rules import short, signature
from kickdrift_validation.fuzzing.session import session


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("number", type=int, help="the first case")
    parser.add_argument("count", type=int, nargs="?", default=1, help="how many cases")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--files", type=Path, metavar="FOLDER", help="write the case's files there")
    given = parser.parse_args()
    make, began = KINDS[given.kind], monotonic()
    numbers = range(given.number, given.number + given.count)
    seen, spent = defaultdict(list), defaultdict(list)
    most = {"seconds": (0.0, -1), "megabytes": (0.0, -1)}
    with session(given.workers) as tried:
        if given.files:
            given.files.mkdir(parents=True, exist_ok=True)
            for number in numbers:
                for name, data in make(number, given.seed).files.items():
                    (given.files / f"{number}-{name}").write_bytes(data)
        for result in tried([(make, number) for number in numbers], given.seed):
            spent[(result["ends"] or [[["none"]]])[0][0][0]].append(result["seconds"])
            most = {key: max(value, (result[key], result["number"])) for key, value in most.items()}
            for finding in result["found"]:
                if signature(finding) not in seen and given.count > 1:
                    print(f"new: {given.kind} {result['number']}: {finding}  [{result['about']}]", flush=True)
                seen[signature(finding)].append((result["number"], finding, result))
            if given.count == 1:
                print(f"{result['about']}: {result['seconds']:.2f} s, {result['megabytes']:.0f} MB")
                for command, status, stopped, err, out in result["ends"]:
                    text = short(f"{err} {out}", 3000)
                    print(f"$ {' '.join(map(ascii, command))}\n  status {status} {stopped}\n{text}")
    for rows in sorted(seen.values(), key=len, reverse=True):
        number, finding, result = min(rows, key=lambda row: row[0])
        command = " ".join(
            short(word, 60) if word.isprintable() and word else ascii(word)
            for word in (result["ends"] or [[[]]])[-1][0]
        )
        print(f"{len(rows):5} times: {finding}\n        case {number}: {command}  [{result['about']}]")
    number = len({row[0] for rows in seen.values() for row in rows})
    print(f"{given.count} cases, {number} break a rule; {monotonic() - began:.0f} s")
    print("at most " + ", ".join(f"{value:.1f} {key} (case {case})" for key, (value, case) in most.items()))
    return int(bool(seen))


if __name__ == "__main__":
    sys.exit(main())
