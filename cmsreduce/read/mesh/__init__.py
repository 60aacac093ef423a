"""Meshes in the formats of meshio: nodes and elements.

The process in which meshio reads a file, and what is made of its result, belong here.
Formats with readers of their own belong in `read.nastran` and `read.calculix_abaqus`.
"""

from cmsreduce.read.mesh.meshes import MESH

__all__ = ["MESH"]
