"""The geometry kind `tendon_finger`: tapered fingers with notches, for cables."""
