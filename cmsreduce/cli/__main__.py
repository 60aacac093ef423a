"""``python -m cmsreduce.cli`` is the command ``cmsreduce``."""

from cmsreduce.cli import main

main()
