"""Where in a recording its viewers are, and how that moves on."""

import numpy as np


class Playback:
    """A position in the frames of a recording.

    Attributes:
        clock: when each frame is shown [s], from 0; a new start of the run takes no time, shape (frame_count,).
        position: of the viewers [s] on that clock.
        playing: whether it moves on.
        speed: recorded over wall-clock time.
    """

    def __init__(self, times: np.ndarray):
        """Begin to play at the first frame; times [s] of all frames, shape (frame_count,)."""
        self.position = 0.0
        self.playing = True
        self.speed = 1.0
        self.extend(times)

    def extend(self, times: np.ndarray) -> None:
        """Take the times of all frames anew: there are more now."""
        self.clock = np.concatenate([[0.0], np.cumsum(np.maximum(np.diff(times), 0.0))])

    @property
    def length(self) -> float:
        """Of the whole recording [s]."""
        return float(self.clock[-1])

    @property
    def frame(self) -> int:
        """Index of the last frame that is not later than the position."""
        return int(np.searchsorted(self.clock, self.position + 1e-9, side="right")) - 1

    def advance(self, seconds: float) -> None:
        """So much wall-clock time [s] has passed; at the end it stands still, and goes on if more is recorded."""
        if self.playing:
            self.position = min(self.position + seconds * self.speed, self.length)

    def play_or_pause(self) -> None:
        """From the end it plays again from the start."""
        self.playing = not self.playing
        if self.playing and self.position >= self.length:
            self.position = 0.0
