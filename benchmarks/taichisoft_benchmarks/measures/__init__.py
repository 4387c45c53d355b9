"""How each kind of case is measured; every measure runs in a process of its own (case_process)."""
