"""Courses of pairs of bodies that may meet, and whether they may: compiled, from the state at a step's start alone.

A trial step that passes through a contact of points tells nothing about the time after it, and little about the
contact. So the course of a pair begins at the state before. The two bodies attract each other, and the tide of all
other bodies on them is a polynomial of the second degree in time, through three points on their way.
"""

import numpy as np

from kickdrift.jit.compile import driver, jit
from kickdrift.run.watch.encounters import hull_bound

AHEAD = 2.0  # steps for which a course is followed
LOOSE = 0.05  # of a distance: more than tides move a pair within a step of a twentieth of an orbit
NEAR = 1.02  # of the sum of the radii: courses that come so near are hits
TIDES = 2e-3  # of a distance: error of a course by what its polynomial does not know
STRONG = 1e-12  # G M h^2 over the cube of the sum of the radii: with less, no step feels the pair's attraction
BENT = 1e-3  # of the speed: a kick of half a step that changes no energy worth the name
FINE = 0.2  # step along a course, over the time scale of its change
MOST = 1000  # steps along a course
ARC = 0.2  # of the sum of the radii: the way of a pair in a part that may pass a contact
HIT, LEAST, LATER = range(3)  # results of a course: time of the hit, least distance, distance after the step
TURNS = 1e-3  # G M h^2 over the cube of a distance: with less, a step resolves the attraction
SAFE = 0.95  # of the time to a contact: a part of a step that ends before
RESOLVED = 0.1  # longest part, over the time scale of the pair's attraction at its end
SHORTEST = 2.0**-12  # shortest part, of the rest of a step


@jit
def is_far(y0, y1, h, i, j, reach, pair, time):
    """Tell whether two bodies stay apart on the cubic between two states, and in this ``time`` from the first one on
    their straight ways and by their attraction. This test has no roots, and clears almost all pairs."""
    start2, w2, b2, way2 = 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        r0, r1 = y0[0, k, i] - y0[0, k, j], y1[0, k, i] - y1[0, k, j]
        u0, u1 = y0[1, k, i] - y0[1, k, j], y1[1, k, i] - y1[1, k, j]
        start2 += r0 * r0
        w2 += u0 * u0
        b2 += (r1 - r0 - h / 3.0 * u1) ** 2
        way2 += (r1 - r0) ** 2
    fall = pair * time * time  # to the third power, the way of a free fall
    rest = start2 - 3.0 * (reach * reach + max(w2 * max(time * time, h * h / 9.0), max(b2, way2)))
    return rest > 0.0 and rest * rest * rest > 27.0 * fall * fall


@jit
def may_meet(y, i, j, reach, pair, time):
    """Tell whether two bodies may come within ``reach`` in this time, by their attraction alone; loosely."""
    d2, w2, rate = 0.0, 0.0, 0.0
    for k in range(3):
        r, u = y[0, k, i] - y[0, k, j], y[1, k, i] - y[1, k, j]
        d2 += r * r
        w2 += u * u
        rate += r * u
    fall = pair * time * time
    rest = d2 - 3.0 * (reach * reach + time * time * w2)
    if rest > 0.0 and rest * rest * rest > 27.0 * fall * fall:
        return False
    d = np.sqrt(d2)
    near = reach + LOOSE * d
    if d <= near:
        return True
    if rate >= 0.0 and 2.0 * rate * d >= time * pair:
        return False  # the bodies part, and turn too late
    return d2 * w2 - rate * rate <= near * near * (w2 + 2.0 * pair * (1.0 / near - 1.0 / d))


@jit
def pull(y, gm, softening2, i, j, time, centre, r, tide, common):
    """tide, common (3,) <- relative acceleration and acceleration of the centre of mass of two bodies by all others.

    The two bodies are at a separation r about ``centre``; the others are ``time`` further on their ways."""
    total = gm[i] + gm[j]
    for k in range(3):
        tide[k] = common[k] = 0.0
    for other in range(gm.size):
        if (other - i) * (other - j) * gm[other] == 0.0:
            continue
        for body, share, sign in ((i, gm[j] / total, 1.0), (j, -gm[i] / total, -1.0)):
            d2 = softening2
            for k in range(3):
                d2 += (y[0, k, other] + time * y[1, k, other] - centre[k] - share * r[k]) ** 2
            weight = gm[other] / (d2 * np.sqrt(d2))
            for k in range(3):
                a = weight * (y[0, k, other] + time * y[1, k, other] - centre[k] - share * r[k])
                tide[k] += sign * a
                common[k] += gm[body] / total * a


@jit
def course(y, i, j, reach, gm, softening2, pair, length, time, found):
    """found (3,) <- time of the first hit within ``time`` (infinite if there is none), least distance, and distance
    after ``length``.

    ``gm`` (n,) are the sources of tides, of which there may be none; ``pair`` is G times the masses of the two bodies.
    """
    r, u, place = np.empty(3), np.empty(3), np.empty(3)
    a, common, tides = np.empty(3), np.empty(3), np.zeros((3, 3))
    d2, w2 = 0.0, 0.0
    for k in range(3):
        r[k], u[k] = y[0, k, i] - y[0, k, j], y[1, k, i] - y[1, k, j]
        d2 += r[k] * r[k]
        w2 += u[k] * u[k]
    span = time if w2 * time * time < d2 else np.sqrt(d2 / w2)
    if gm.size > 0:
        share = gm[i] / pair
        for point in range(3):
            t = 0.5 * point * span
            for k in range(3):
                a[k] = r[k] + t * u[k] + t * t / 3.0 * tides[0, k]
                place[k] = share * (y[0, k, i] + t * y[1, k, i]) + (1.0 - share) * (y[0, k, j] + t * y[1, k, j])
                if point:
                    place[k] += 0.5 * t * t * common[k]
            if point == 0:
                pull(y, gm, softening2, i, j, t, place, a, tides[0], common)
            else:
                pull(y, gm, softening2, i, j, t, place, a, tides[point], np.empty(3))
    near = NEAR * reach + TIDES * np.sqrt(d2)
    found[HIT], found[LEAST], found[LATER] = np.inf, np.sqrt(d2), np.sqrt(d2)
    x, kick = np.empty(3), np.empty((4, 3))
    t, d = 0.0, np.sqrt(d2)
    if d <= near:
        found[HIT] = 0.0
        return
    for _ in range(MOST):
        w2 = u[0] * u[0] + u[1] * u[1] + u[2] * u[2]
        q = d * d + softening2
        scale = np.sqrt(q * np.sqrt(q) / pair) if pair > 0.0 else np.inf
        if w2 * scale * scale > d * d:
            scale = d / np.sqrt(w2)
        s = min(FINE * scale, time - t)
        if t < length < t + s:
            s = length - t
        for stage in range(4):  # Nystrom's method of order 4, with the midpoint twice as in Runge and Kutta's
            c = 0.0 if stage == 0 else 0.5 if stage < 3 else 1.0
            part = min((t + c * s) / span, 1.0)
            for k in range(3):
                x[k] = r[k] + c * s * u[k]
                if stage == 2:
                    x[k] += 0.25 * s * s * kick[0, k]
                if stage == 3:
                    x[k] += 0.5 * s * s * kick[1, k]
            x2 = x[0] * x[0] + x[1] * x[1] + x[2] * x[2] + softening2
            weight = pair / (x2 * np.sqrt(x2))
            one, two, three = (1 - part) * (1 - 2 * part), 4 * part * (1 - part), part * (2 * part - 1)
            for k in range(3):
                kick[stage, k] = one * tides[0, k] + two * tides[1, k] + three * tides[2, k] - weight * x[k]
        d2, rate = 0.0, 0.0
        for k in range(3):
            r[k] += s * u[k] + s * s / 6.0 * (kick[0, k] + kick[1, k] + kick[2, k])
            u[k] += s / 6.0 * (kick[0, k] + 2.0 * kick[1, k] + 2.0 * kick[2, k] + kick[3, k])
            d2 += r[k] * r[k]
            rate += r[k] * u[k]
        t, before, d = t + s, d, np.sqrt(d2)
        found[LEAST] = min(found[LEAST], d)
        if t <= length:
            found[LATER] = d
        if d <= near:
            found[HIT] = t - s * min(1.0, (near - d) / max(before - d, 1e-300))
            return
        if not t < time:
            return


@jit
def speed2(y, i, j):
    """Squared relative speed of two bodies."""
    total = 0.0
    for k in range(3):
        total += (y[1, k, i] - y[1, k, j]) ** 2
    return total


@jit
def bends(distance, pair, h, w2):
    """Tell whether the attraction at a distance kicks a pair by more than a small part of its speed in half a step."""
    return pair * h > 2.0 * BENT * np.sqrt(w2) * distance * distance


@jit
def course_back(y, i, j, reach, softening2, pair, length, found, back):
    """Fill ``found`` as ``course`` does, back in time and without tides."""
    for half in range(2):
        sign = 1.0 - 2.0 * half
        for k in range(3):
            back[half, k, 0], back[half, k, 1] = sign * y[half, k, i], sign * y[half, k, j]
    course(back, 0, 1, reach, np.empty(0), softening2, pair, length, AHEAD * length, found)


@jit
def distance(y, i, j):
    """Distance of two bodies."""
    total = 0.0
    for k in range(3):
        total += (y[0, k, i] - y[0, k, j]) ** 2
    return np.sqrt(total)


@jit
def is_strong(y, h, i, j, reach, pair):
    """Tell whether two bodies may attract each other without bound in a step: it may lead them deep into each other."""
    if not pair * h * h > STRONG * reach * reach * reach:
        return False
    return (speed2(y, i, j) + 2.0 * pair / reach) * h * h > ARC * ARC * reach * reach


@jit
def is_suspect(y, h, i, j, reach, sources, softening2, pair, ahead, found):
    """Tell whether two bodies may touch in a step from y, or so soon after the step that its end needs care. The last
    evaluation of the forces is at the part ``ahead`` of the step."""
    if not may_meet(y, i, j, reach, pair, AHEAD * h):
        return False
    course(y, i, j, reach, sources, softening2, pair, h, AHEAD * h, found)
    return found[HIT] <= ahead * h or (found[HIT] < np.inf and bends(found[LATER], pair, h, speed2(y, i, j)))


@jit
def may_touch(y, h, i, j, reach, gm, sources, softening2, found):
    """Tell whether two bodies that attract each other may touch in a step from y, or soon after it."""
    pair = gm[i] + gm[j]
    return is_strong(y, h, i, j, reach, pair) and is_suspect(y, h, i, j, reach, sources, softening2, pair, 1.0, found)


@jit
def leaves(y, h, i, j, reach, softening2, pair, behind, found, back):
    """Tell whether two bodies touched so short a time before y that a step needs care. The first evaluation of the
    forces is at the part -``behind`` of the step."""
    course_back(y, i, j, reach, softening2, pair, h, found, back)
    return found[HIT] <= behind * h or (found[HIT] < np.inf and bends(distance(y, i, j), pair, h, speed2(y, i, j)))


@driver
def all_far(y0, y1, h, pairs, touching, limits):
    """Tell whether no pair may touch in a step from y0 to y1 or soon after, and none is known to touch; loosely.

    ``limits`` (2, P) are their distances at contact, and G times their masses."""
    for p in range(pairs.shape[1]):
        i, j, reach, pair = pairs[0, p], pairs[1, p], limits[0, p], limits[1, p]
        if touching[p]:
            return False
        if is_far(y0, y1, h, i, j, NEAR * reach, pair, AHEAD * h) or reach == 0.0:
            continue
        if not hull_bound(y0, y1, h, i, j) > NEAR * reach or may_meet(y0, i, j, reach, pair, AHEAD * h):
            return False
    return True


@driver
def suspects(y0, y1, h, pairs, touching, radii, gm, sources, softening2, fresh, ahead, behind, rows):
    """rows (P + 1,) <- numbers of the ``pairs`` that may touch in a step from y0 to y1, or soon after. Return how many.

    The last row is the number of pairs that are known to touch, or near each other on the cubic without coming deep
    into each other. ``gm`` (n,) is G times the masses; ``sources`` (n,) are those of tides, or (0,). ``fresh`` (n,) or
    (0,) bodies come from a contact."""
    found, back, count, others = np.empty(3), np.empty((2, 3, 2)), 0, 0
    for p in range(pairs.shape[1]):
        i, j = pairs[0, p], pairs[1, p]
        reach, pair = radii[i] + radii[j], gm[i] + gm[j]
        others += touching[p]
        if reach == 0.0 or (fresh.size == 0 and is_far(y0, y1, h, i, j, NEAR * reach, pair, AHEAD * h)):
            continue
        near = hull_bound(y0, y1, h, i, j) <= NEAR * reach
        if not is_strong(y0, h, i, j, reach, pair):
            others += near
            continue
        near = near or is_suspect(y0, h, i, j, reach, sources, softening2, pair, ahead, found)
        if not near and fresh.size > 0 and fresh[i] and fresh[j]:
            near = leaves(y0, h, i, j, reach, softening2, pair, behind, found, back)
        if near:
            rows[count] = p
            count += 1
    rows[rows.size - 1] = others
    return count


@driver
def any_bends(y, h, pairs, limits, heaviest, gm, softening2, inside):
    """Tell whether one of the ``pairs`` passes within its limit in a step or soon after, unbound, and so near that a
    step does not resolve the attraction. Limits are those of `encounters.passages`. With ``inside``, also if an
    unbound pair is within its limit."""
    found = np.empty(3)
    for p in range(pairs.shape[1]):
        i, j = pairs[0, p], pairs[1, p]
        d2, w2, pair = 0.0, 0.0, gm[i] + gm[j]
        for k in range(3):
            d2 += (y[0, k, i] - y[0, k, j]) ** 2
            w2 += (y[1, k, i] - y[1, k, j]) ** 2
        limit = limits[p]
        if heaviest >= 0:
            limit *= 0.5 * (distance(y, i, heaviest) + distance(y, j, heaviest))
        way = AHEAD * h
        if d2 > 2.0 * (limit * limit + way * way * w2) or not w2 * w2 * d2 > 4.0 * pair * pair > 0.0:
            continue
        if inside and d2 < limit * limit:
            return True
        course(y, i, j, 0.0, gm, softening2, pair, h, AHEAD * h, found)
        if found[LEAST] < limit and pair * h * h > TURNS * found[LEAST] ** 3:
            return True
    return False


@driver
def soon(y, h, pairs, radii, gm, sources, softening2, fresh, ahead, behind):
    """Tell whether one of the ``pairs`` touches so soon after y, or left a contact so shortly before, that a step of
    length h spoils its velocity."""
    found, back = np.empty(3), np.empty((2, 3, 2))
    for p in range(pairs.shape[1]):
        i, j = pairs[0, p], pairs[1, p]
        reach, pair = radii[i] + radii[j], gm[i] + gm[j]
        if (
            fresh.size > 0
            and fresh[i]
            and fresh[j]
            and leaves(y, h, i, j, reach, softening2, pair, behind, found, back)
        ):
            return True
        course(y, i, j, reach, sources, softening2, pair, h, (AHEAD - 1.0) * h, found)
        if found[HIT] <= (ahead - 1.0) * h:
            return True
        if found[HIT] < np.inf and bends(distance(y, i, j), pair, h, speed2(y, i, j)):
            return True
    return False


@driver
def room(y, left, pairs, radii, gm, sources, softening2, fresh, ahead, behind, fine):
    """Return the longest part of a step that ends before the ``pairs`` touch, or shortly after they touch.

    A method evaluates forces at times between -``behind`` and ``ahead`` of its step. Pairs of ``fresh`` bodies (n,)
    come from a contact, so their way back is no way for a step either. With ``fine``, parts are short where the pairs'
    attraction changes fast."""
    found, back, longest = np.empty(3), np.empty((2, 3, 2)), left
    for p in range(pairs.shape[1]):
        i, j = pairs[0, p], pairs[1, p]
        reach, pair = radii[i] + radii[j], gm[i] + gm[j]
        w, d = np.sqrt(speed2(y, i, j) + 2.0 * pair / reach), distance(y, i, j)
        for way in range(2):
            if way == 0:
                course(y, i, j, reach, sources, softening2, pair, left, AHEAD * left, found)
                part = ahead
            else:
                if not (fine and fresh.size > 0 and fresh[i] and fresh[j]):
                    continue
                course_back(y, i, j, reach, softening2, pair, left, found, back)
                part = behind
            if found[HIT] == np.inf:
                continue
            if part > 0.0:
                longest = min(longest, max(SAFE * found[HIT] / part, ARC * reach / w))
            if not fine:
                continue
            s = longest
            for _ in range(100):
                end = max(reach, d - w * s) if way == 0 else d
                if s <= RESOLVED * np.sqrt(end * end * end / pair):
                    break
                s *= 0.8
            longest = min(longest, s)
    return max(longest, left * SHORTEST)
