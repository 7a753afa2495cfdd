"""Drift of the bodies that meet: who meets whom, and their common motion in place of Kepler orbits.

Massive bodies that are near one another form a group. Each group moves by itself. While a massive body passes its
pericentre, all massive bodies are one group. A massless body moves with copies of the massive bodies near it. In its
own pericentre passage it moves with copies of all massive bodies. It changes none of them.
"""

from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.trace.extrapolation import follow_by_extrapolation
from kickdrift.integrators.trace.meeting import follow, note_path
from kickdrift.integrators.trace.others import meets_any, momentum
from kickdrift.integrators.trace.state import ALL, FIRST_NOTED, FULL, GAUSS_RADAU, HEAVY, INSIDE, NUMBER
from kickdrift.integrators.wisdom_holman.bodies import LIVE, OTHERS, SOURCE
from kickdrift.jit.compile import jit

ALONE = -1  # of a massive body in no group


@jit
def find_groups(hybrid):
    """Number the groups of massive bodies that are near one another. Return how many there are.

    With other forces inside, all these bodies are one group: each may feel where the others are."""
    near, meets, group = hybrid.near, hybrid.meets, hybrid.group
    massive, found, together = group.size, 0, hybrid.present[INSIDE] != 0
    for i in range(massive):
        group[i] = ALONE
    for i in range(massive):
        if group[i] != ALONE or meets[i] == 0:
            continue
        group[i] = found
        grown = True
        while grown:
            grown = False
            for j in range(massive):
                if group[j] == found:
                    for k in range(massive):
                        if group[k] == ALONE and (near[j, k] or (together and meets[k] > 0)):
                            group[k], grown = found, True
        found += 1
    return found


@jit
def join(hybrid, i, jumps):
    """Add the body in slot i to the bodies that meet. With ``jumps`` its velocity is from the central body."""
    meeting = hybrid.meeting
    k = meeting.size[NUMBER]
    meeting.slots[k], meeting.gm[k], meeting.jumps[k] = i, hybrid.bodies.table[SOURCE, i], jumps
    meeting.acts[k] = meets_any(hybrid, i)
    meeting.size[NUMBER] = k + 1


@jit
def move_together(hybrid, others, h):
    """Move the bodies that have joined over a time h. They start from ``middle``; ``meeting`` has the end. Return a
    status."""
    meeting, middle, share = hybrid.meeting, hybrid.middle, hybrid.bodies.table[OTHERS]
    n = meeting.size[NUMBER]
    for k in range(3):
        for i in range(n):
            meeting.x[k * n + i] = middle[k, meeting.slots[i]]
            meeting.v[k * n + i] = middle[3 + k, meeting.slots[i]]
        move = momentum(hybrid, k)
        for i in range(n):
            if meeting.jumps[i]:
                meeting.v[k * n + i] += move
    note_path(hybrid, 0.0)
    status = follow(hybrid, others, h) if hybrid.inner == GAUSS_RADAU else follow_by_extrapolation(hybrid, others, h)
    if status != OK:
        return status
    for k in range(3):
        move, mass = momentum(hybrid, k), 1.0
        for i in range(n):
            if meeting.jumps[i]:
                mass += share[meeting.slots[i]]
        for i in range(n):
            if meeting.jumps[i]:
                meeting.v[k * n + i] -= move / mass
    return OK


@jit
def keep(hybrid, first):
    """Write the end of the common motion to the orbits, for the bodies from number ``first`` on."""
    meeting, orbit = hybrid.meeting, hybrid.bodies.orbit
    n = meeting.size[NUMBER]
    for i in range(first, n):
        for k in range(3):
            orbit[k, meeting.slots[i]] = meeting.x[k * n + i]
            orbit[3 + k, meeting.slots[i]] = meeting.v[k * n + i]


@jit
def passage_of_massive(hybrid, others, h, moved):
    """Move all massive bodies together from ``middle``. moved <- minus the way that the central body goes by their
    attraction. Return a status."""
    meeting, share, live = hybrid.meeting, hybrid.bodies.table[OTHERS], hybrid.bodies.table[LIVE]
    meeting.size[NUMBER], meeting.size[ALL], meeting.size[FIRST_NOTED] = 0, hybrid.way == FULL, 0
    mass = 1.0
    for i in range(hybrid.group.size):
        if live[i] != 0.0:
            join(hybrid, i, 1)
            mass += share[i]
    status = move_together(hybrid, others, h)
    if status != OK:
        return status
    n = meeting.size[NUMBER]
    for k in range(3):
        moved[k] = 0.0
        for i in range(n):
            moved[k] += share[meeting.slots[i]] * (meeting.x[k * n + i] - hybrid.middle[k, meeting.slots[i]]) / mass
    return OK


@jit
def groups_of_massive(hybrid, others, h):
    """Move each group of massive bodies that meet. Return a status."""
    found, size = find_groups(hybrid), hybrid.meeting.size
    for number in range(found):
        size[NUMBER], size[ALL], size[FIRST_NOTED] = 0, 0, 0
        for i in range(hybrid.group.size):
            if hybrid.group[i] == number:
                join(hybrid, i, 0)
        status = move_together(hybrid, others, h)
        if status != OK:
            return status
        keep(hybrid, 0)
    return OK


@jit
def joins_massless(hybrid, i, j):
    """Tell whether the massless body i is near the massive body j, or near another body of j's group."""
    if hybrid.near[j, i]:
        return True
    if hybrid.group[j] != ALONE:
        for k in range(hybrid.group.size):
            if hybrid.group[k] == hybrid.group[j] and hybrid.near[k, i]:
                return True
    return False


@jit
def each_massless(hybrid, others, h):
    """Move each massless body that is near a massive one or passes its pericentre. Copies of massive bodies move along.
    Return a status."""
    meeting, live, passes = hybrid.meeting, hybrid.bodies.table[LIVE], hybrid.passes
    heavy = hybrid.counts[HEAVY] > 0
    for i in range(hybrid.group.size, passes.size):
        if live[i] == 0.0 or not (hybrid.meets[i] or passes[i]):
            continue
        jumps = heavy or passes[i] != 0
        meeting.size[NUMBER], meeting.size[ALL] = 0, 0
        for j in range(hybrid.group.size):
            if live[j] != 0.0 and (jumps or joins_massless(hybrid, i, j)):
                join(hybrid, j, heavy)
        join(hybrid, i, jumps)
        meeting.size[ALL], meeting.size[FIRST_NOTED] = heavy and hybrid.way == FULL, meeting.size[NUMBER] - 1
        status = move_together(hybrid, others, h)
        if status != OK:
            return status
        keep(hybrid, meeting.size[NUMBER] - 1)
    return OK
