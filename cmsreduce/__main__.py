"""The program as ``python -m cmsreduce``."""

import runpy

if __name__ == "__main__":
    runpy.run_module("cmsreduce.cli", run_name="__main__", alter_sys=True)
