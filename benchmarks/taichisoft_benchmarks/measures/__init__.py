"""How each kind of case is measured; every measurement runs in a process of its own (case_process)."""
