"""The program as ``python -m cmsreduce``."""

from cmsreduce.cli.__main__ import start

if __name__ == "__main__":
    start()
