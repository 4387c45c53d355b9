"""The outputs that come with taichisoft: recording, metrics, pictures."""
