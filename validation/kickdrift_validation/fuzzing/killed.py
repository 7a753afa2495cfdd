"""Kills: a run, a resume or an ensemble ends by SIGKILL at a random moment, and goes on to the same bits."""

from kickdrift_validation.fuzzing.case import Case, dice
from kickdrift_validation.fuzzing.places import ENSEMBLE, JOURNAL, LONG_EVERY, LONG_STEPS
from kickdrift_validation.fuzzing.run_files import NAME, base

KIND = "kills"
EVERY_ENSEMBLE = 12  # one case in so many is an ensemble, whose processes take seconds to start
RUN_SECONDS, RESUME_SECONDS = 0.8, 0.5  # of work, about as much as they take
ENSEMBLE_SECONDS = 6.0  # by the clock, since most of its work is done by others


def case(number: int, seed: int = 0) -> Case:
    """The case of that number; its moment is drawn, what the process does then is for the machine to say."""
    rng = dice(KIND, seed, number)
    if number % EVERY_ENSEMBLE == EVERY_ENSEMBLE - 1:
        after, files = rng.uniform(0.2, ENSEMBLE_SECONDS), {"s.toml": base("s.toml")}
        commands, about = (ENSEMBLE, ("!ensemble_goes_on",)), "ensemble"
    elif number % 3 == 2:
        after, files = rng.uniform(0.0, RESUME_SECONDS), {NAME: base("half.h5md")}
        commands, about = (("resume", NAME, "--flush", "1e-9", "--quiet"), ("!goes_on", NAME, "long.h5md")), "resume"
    else:
        after, files = rng.uniform(0.0, RUN_SECONDS), {"s.toml": base("s.toml")}
        length = ("--steps", str(LONG_STEPS), "--every", str(LONG_EVERY))
        run = ("run", "s.toml", *length, "--output", NAME, "--flush", "1e-9", "--quiet")
        commands, about = (run, ("!goes_on", NAME, "long.h5md")), "run"
    changed = frozenset({NAME, "t.parquet", JOURNAL, "t.parquet.lock"})
    return Case(KIND, number, commands, f"{about}, {after:.3f} s", files, changed, (0,), kill_after=after)
