"""Other programs that can do part of the job, each with what it leaves out; none is needed to run taichisoft."""
