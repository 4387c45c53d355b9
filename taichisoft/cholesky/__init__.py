"""Sparse Cholesky factorisation on blocks of 3x3."""
