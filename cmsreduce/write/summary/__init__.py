"""Summaries of runs and sweeps: summary.json, CSV and HDF5 tables.

Stable keys and columns belong here.
Words for people belong in `report`.
"""

from cmsreduce.write.summary.stored_summary import read_summary, write_summary
from cmsreduce.write.summary.summary import summary
from cmsreduce.write.summary.sweep_table import write_sweep_csv, write_sweep_table

__all__ = ["read_summary", "summary", "write_summary", "write_sweep_csv", "write_sweep_table"]
