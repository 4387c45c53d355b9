"""Where plug-ins come from, how they are checked and listed, and how a new one begins."""
