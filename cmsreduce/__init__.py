"""Reduce finite-element bodies to checked components for multibody simulation."""

import os

# The threads of OpenBLAS wait for more work by spinning, some 60 ms by default, on the cores that the sparse solver
# needs next: told before numpy loads it, they sleep at once.
os.environ.setdefault("OPENBLAS_THREAD_TIMEOUT", "4")


def __getattr__(name: str) -> str:
    # Looking the version up takes longer than all else that a command needs to start.
    if name == "__version__":
        from importlib.metadata import version

        return version("cmsreduce")
    raise AttributeError(f"module 'cmsreduce' has no attribute '{name}'")
