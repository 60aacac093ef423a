"""Program ``mesh_process.py MESH ARRAYS BYTES SECONDS``: meshio reads a mesh, and its points and cells are saved.

It runs in a process of its own, because meshio believes the sizes in a file, prints, exits, and loops without end on
some damaged files. It imports nothing of cmsreduce, so that it starts quickly.
"""

import contextlib
import sys
import warnings


def main(mesh: str, arrays: str, most_bytes: str, seconds: str) -> None:
    """Read a mesh in so many bytes and seconds of a processor at most; stderr has the reason of a failure."""
    with contextlib.suppress(ImportError, ValueError, OSError):
        # Windows has no such limits.
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (int(most_bytes), int(most_bytes)))
        resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds)))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    import meshio
    import numpy as np

    warnings.simplefilter("ignore")
    found = meshio.read(mesh)
    cells = {f"{number} {block.type}": np.asarray(block.data) for number, block in enumerate(found.cells)}
    np.savez(arrays, points=np.asarray(found.points), **cells)  # type: ignore[arg-type]


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except Exception as error:
        # meshio's readers fail on damaged files with errors of any class, and the message is all that this process has
        # to say.
        said = " ".join(str(error).split()) or type(error).__name__
        sys.exit("the sizes in it need more memory than its bytes justify" if isinstance(error, MemoryError) else said)
