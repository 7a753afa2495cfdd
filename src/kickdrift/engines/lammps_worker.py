"""One of LAMMPS' processes, started by mpiexec for ``lammps_processes``.

It executes commands and answers each with an error text or None. The first process also sends the result.
"""

import os
import select
import shutil
import socket
import threading
import time
from multiprocessing.connection import Connection
from pathlib import Path

from kickdrift.engines.hosts import connected
from kickdrift.engines.lammps_processes import END_SECONDS, KEY, SOCKET
from kickdrift.engines.lammps_world import World


def main() -> None:
    """Serve until the other side closes the connection."""
    key, where = bytes.fromhex(os.environ.pop(KEY, "")), os.environ[SOCKET]
    orders = connected(where, key) if key else beside(where)
    threading.Thread(target=_end_with, args=(orders.fileno(),), daemon=True).start()
    try:
        world = World()
        rank = world.rank
    except Exception as error:
        orders.send((str(error), None))
        return
    orders.send((None, rank))
    while True:
        try:
            what, arguments = orders.recv()
        except (EOFError, OSError):
            break
        try:
            result = getattr(world, what)(*arguments)
            orders.send((None, result if rank == 0 else None))
        except OSError:
            break
        except Exception as error:  # from LAMMPS
            orders.send((str(error), None))
    world.close()
    world.lmp.finalize()
    if rank == 0 and not key:  # a killed process cannot report
        shutil.rmtree(Path(where).parent, ignore_errors=True)


def _end_with(orders: int) -> None:
    """End this process after the other side, also if it waits for another process in MPI."""
    closed = getattr(select, "POLLRDHUP", select.POLLHUP)
    waiting = select.poll()
    waiting.register(orders, closed)
    waiting.poll()
    time.sleep(END_SECONDS)  # a process that waits for orders ends by itself
    os._exit(1)


def beside(path: str) -> Connection:
    stream = socket.socket(socket.AF_UNIX)
    stream.connect(path)
    return Connection(stream.detach())


if __name__ == "__main__":
    main()
