"""Sparse kernels behind small interfaces: factorisation, eigenpairs, null spaces."""
