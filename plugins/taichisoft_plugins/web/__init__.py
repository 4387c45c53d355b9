"""The live web page of a run, and of a recording. Nothing here is imported unless somebody asks for a page."""
