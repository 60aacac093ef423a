"""Meshes of no particular program: nodes and elements, in the formats of meshio and in universal files.

What is made of the result of a library belongs here; the process in which it reads belongs in `read.libraries`.
Formats with readers of their own belong in `read.nastran` and `read.calculix_abaqus`.
"""

from cmsreduce.read.mesh.meshes import MESH
from cmsreduce.read.mesh.universal import UNIVERSAL, universal_arrays

__all__ = ["MESH", "UNIVERSAL", "universal_arrays"]
