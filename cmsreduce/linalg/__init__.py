"""Linear algebra of sparse bodies and small dense systems.

The rooms are machine, blocks, sparse, eigen, response and gramian; each is imported by its own name.
Nothing here knows what a node, a joint or a mode set is.
"""

__all__ = []
