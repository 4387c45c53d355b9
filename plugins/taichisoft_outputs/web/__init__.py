"""The live web page of a run, and of a recording. Imported only by runs with a page."""
