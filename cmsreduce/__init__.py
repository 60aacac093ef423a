"""Reduce finite-element bodies to checked components for multibody simulation."""


def __getattr__(name: str) -> str:
    # Looking the version up takes longer than all else that a command needs to start.
    if name == "__version__":
        from importlib.metadata import version

        return version("cmsreduce")
    raise AttributeError(f"module 'cmsreduce' has no attribute '{name}'")
