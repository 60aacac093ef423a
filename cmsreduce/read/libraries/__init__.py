"""Libraries that read a file in a process of their own, within limits of memory and time.

`program` is what runs there, with `universal` beside it; neither imports anything of cmsreduce.
What is made of their arrays belongs in the rooms of the formats, such as `read.mesh`.
"""

from cmsreduce.read.libraries.arrays import Arrays, arrays_of, cells_of

__all__ = ["Arrays", "arrays_of", "cells_of"]
