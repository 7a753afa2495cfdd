"""One of LAMMPS' processes, started by mpiexec for ``lammps_processes``.

It executes commands and answers each with an error text or None. The first process also sends the result.
"""

from __future__ import annotations

import os
import shutil
import socket
from multiprocessing.connection import Connection
from pathlib import Path

from kickdrift.engines.lammps_processes import SOCKET
from kickdrift.engines.lammps_world import World


def main() -> None:
    """Serve until the other side closes the connection."""
    connected = socket.socket(socket.AF_UNIX)
    connected.connect(os.environ[SOCKET])
    orders = Connection(connected.detach())
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
    if rank == 0:  # a killed process cannot report
        shutil.rmtree(Path(os.environ[SOCKET]).parent, ignore_errors=True)


if __name__ == "__main__":
    main()
