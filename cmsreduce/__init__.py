"""Reduce finite-element bodies to checked components for multibody simulation."""

import os
from importlib.metadata import version

# The threads of OpenBLAS wait for more work by spinning, some 60 ms by default, on the cores that the sparse solver
# needs next: told before numpy loads it, they sleep at once.
os.environ.setdefault("OPENBLAS_THREAD_TIMEOUT", "4")

__version__ = version("cmsreduce")
