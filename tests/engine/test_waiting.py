"""Threads wait for one another, but not for long."""

import numpy as np

from taichisoft.runtime import kernel, ti
from taichisoft.runtime.arithmetic import BEGUN, COUNTERS, FINISHED, reaches
from taichisoft.runtime.language import Integers


@kernel
def wait(progress: Integers, count: ti.i32, patience: ti.i32, answer: Integers):
    answer[0] = reaches(progress, FINISHED, count, patience)


def test_a_thread_waits_no_longer_than_its_patience():
    progress, answer = np.zeros(COUNTERS, dtype=np.int32), np.empty(1, dtype=np.int32)
    progress[BEGUN], progress[FINISHED] = 9, 6
    answers = []
    for count, patience in ((6, 0), (7, 0), (7, 1000), (5, 1000)):
        wait(progress, count, patience, answer)
        answers.append(int(answer[0]))
    assert answers == [1, 0, 0, 1]
    assert progress.tolist() == [9, 6, 0]
