"""The frame of a component file in lines."""

from __future__ import annotations

from collections.abc import Iterator

from cmsreduce.write import ComponentFile

__all__ = ["frame_lines"]


def frame_lines(file: ComponentFile) -> Iterator[str]:
    """State the support, what the integrals are about, and what hangs on the interfaces."""
    if "support" in file.attributes[""]:
        yield str(file.attributes[""]["support"])
    integrals = file.attributes.get("integrals", {})
    if "lumping" in integrals and "about" in integrals:
        yield f"integrals about {integrals['about']}, mass {integrals['lumping']}"
    for path, names in file.texts.items():
        if path.startswith("augmented/"):
            face = path.split("/")[1]
            mass = float(file.arrays[f"augmented/{face}/mass"])
            yield f"outboard of {face}: mass {mass:.9g} of {', '.join(names) or 'its joint'}"
