"""Functional Mock-up Units: linear models for model exchange and co-simulation, FMI 3.0 and 2.0.

`unit` writes the archive with C sources and, where there is a compiler, their binary; `description` its XML.
Which model a unit holds is decided by `body` for a body, and by `pipeline` for an assembled system.
"""

from cmsreduce.write.targets.fmi.body import write_body_unit
from cmsreduce.write.targets.fmi.linear_model import LinearModel, Port
from cmsreduce.write.targets.fmi.unit import FMI_DIALECTS, unit_binary, write_unit

__all__ = ["FMI_DIALECTS", "LinearModel", "Port", "unit_binary", "write_body_unit", "write_unit"]
