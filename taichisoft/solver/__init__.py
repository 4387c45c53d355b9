"""The equations of a step: sparse Cholesky, constraints, Gauss-Seidel."""
