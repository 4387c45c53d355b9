"""Threads of a kernel that wait for one another, but not for long.

A thread that waits keeps its core busy. Where another program runs, that may be the very core which the thread it waits
for has lost, and would get back in some milliseconds: waiting without end, two threads take several times as long as
one. So a thread waits as long as the work of the other takes and then leaves what is left to it. It must not hold
anything that only it would do. Whoever finishes last never waits, so that all gets done.
"""

from taichisoft.runtime.language import Integers, func, ti

# Counters of work in two parts, all 0 at the start: tasks begun and tasks finished of the first part, and tasks begun
# of the second part.
BEGUN, FINISHED, BEGUN_LATER = range(3)
COUNTERS = 3
# Time of a look at a counter, about [ns], and a patience for tasks of less than 0.2 ms: some 0.5 ms.
PER_LOOK = 10.0
PATIENCE = 50_000


@func
def load(counters: Integers, i: ti.i32) -> ti.i32:
    """Read a number that other threads change; the compiler may not move this load."""
    return ti.atomic_max(counters[i], 0)


@func
def reaches(counters: Integers, i: ti.i32, count: ti.i32, patience: ti.i32) -> ti.i32:
    """Whether a counter reaches `count` within `patience` readings."""
    looks = 0
    while load(counters, i) < count and looks < patience:
        looks += 1
    return load(counters, i) >= count
