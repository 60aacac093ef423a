"""Reduce finite-element bodies to checked components for multibody simulation."""

from importlib.metadata import version

__version__ = version("cmsreduce")
