"""The program that runs another one, and ends it once the process that started both is gone.

Arguments are the other program's command line. Standard input is a pipe that only the first process holds open, so it
ends with that process however that process ends. This module imports nothing of kickdrift.
"""

import contextlib
import os
import signal
import subprocess
import sys
import threading

END_SECONDS = 5.0  # between asking and killing


def main() -> None:
    """Exit with the other program's status."""
    asked = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: asked.set())
    program = subprocess.Popen(sys.argv[1:], stdin=subprocess.DEVNULL)

    def until_gone() -> None:
        os.read(0, 1)
        asked.set()

    def ended() -> None:
        asked.wait()
        program.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            program.wait(END_SECONDS)
        program.kill()

    for work in (until_gone, ended):
        threading.Thread(target=work, daemon=True).start()
    status = program.wait()
    sys.exit(status if status >= 0 else 128 - status)


if __name__ == "__main__":
    main()
