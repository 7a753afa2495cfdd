"""Does anything break the program: system files, command lines, run files and other inputs that are broken, and kills?

Generators of the package `fuzzing` make the cases, always the same ones. Every command runs in a process of its own,
which is watched. No case may end in a traceback, take more than 10 s or more than 1 GiB. Exit status 2 comes with one
line on standard error. A command touches only the files that it is asked to write. A damaged file gives the right
frames or an error. A run that is killed goes on to the same bits.
``python -m kickdrift_validation.fuzzing KIND NUMBER`` repeats a case.
"""

import sys
from collections import Counter
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

from kickdrift_validation.claim import Claim, at_most, claim, main, not_run
from kickdrift_validation.fuzzing.actions import FRAMES, LOST, NO_FILE, WRONG
from kickdrift_validation.fuzzing.kinds import KINDS

SHORT = {"system-files": 300, "command-lines": 150, "run-files": 150, "flipped-bytes": 150, "kills": 12}
SHORT |= {"archives": 60, "hosts": 60, "lammps-data": 60, "dicts": 120, "tables": 150, "more-commands": 150}
LONG = {"system-files": 10_000, "command-lines": 5000, "run-files": 2500, "flipped-bytes": 2500, "kills": 200}
LONG |= {"archives": 800, "hosts": 600, "lammps-data": 600, "dicts": 2000, "tables": 2000, "more-commands": 3000}
NEEDS = {"archives": "rebound", "lammps-data": "ase"}  # packages
WORKERS = 2
SHOWN = 20  # findings of each kind
RULES = "the rules of fuzzing/rules.py"


def tell(kind: str, results: list[dict[str, Any]]) -> None:
    """Print each distinct finding, with the first case that shows it."""
    from kickdrift_validation.fuzzing.rules import signature

    count, first = Counter[str](), dict[str, tuple[int, str]]()
    for result in sorted(results, key=lambda result: result["number"]):
        for finding in result["found"]:
            count[signature(finding)] += 1
            first.setdefault(signature(finding), (result["number"], finding))
    for sign, times in count.most_common(SHOWN):
        number, finding = first[sign]
        print(f"  {times:5} times, first {kind} {number}: {finding}")


def claims(long: bool = False) -> Iterator[Claim]:
    """How many cases of each kind break a rule, and what the dearest of all takes."""
    if sys.platform != "linux":
        yield not_run("no case breaks a rule", "0", RULES, "Linux")
        return
    from kickdrift_validation.fuzzing.session import session
    from kickdrift_validation.fuzzing.watch import Limits

    limits, seconds, megabytes = Limits(), 0.0, 0.0
    with session(WORKERS, limits) as tried:
        for kind, number in (LONG if long else SHORT).items():
            if find_spec(NEEDS.get(kind, "numpy")) is None:
                yield not_run(f"{kind}: cases, of {number:,}, that break a rule", "0", RULES)
                continue
            results = list(tried((KINDS[kind], k) for k in range(number)))
            tell(kind, results)
            seconds = max(seconds, *(each["seconds"] for each in results))
            megabytes = max(megabytes, *(each["megabytes"] for each in results))
            broken = sum(bool(each["found"]) for each in results)
            yield claim(f"{kind}: cases, of {number:,}, that break a rule", broken, "0", broken == 0, RULES)
            if kind in ("flipped-bytes", "tables"):
                wrong = sum(any(FRAMES in text or WRONG in text for text in each["found"]) for each in results)
                text = f"silent wrong {'frames' if kind == 'flipped-bytes' else 'tables'}, of {number:,} damaged files"
                yield claim(text, wrong, "0", wrong == 0, "the file that was not damaged")
            if kind == "kills":
                files = sum(NO_FILE not in each["ends"][-1][4] for each in results)
                text = f"kills, of {number}, that left a file or a journal"
                yield claim(text, files, f"at least {number // 3}", files >= number // 3, "the moments are drawn")
                wrong = sum(any(LOST in text for text in each["found"]) for each in results)
                yield claim(f"kills, of {number}, that lose a bit", wrong, "0", wrong == 0, "what was not killed")
    text = "longest work of a command without compiling, s"
    yield at_most(text, seconds, limits.seconds, "the processor's time")
    yield at_most("most memory of a process, MiB", megabytes, limits.memory / 2**20, "the system's count")


if __name__ == "__main__":
    main(claims, __doc__)
