"""The program: ``cmsreduce`` and ``python -m cmsreduce.cli``."""

import signal


def start() -> None:
    """Run the command line; Ctrl-C before and after the command ends the process without a traceback.

    A command that is at work says what is kept. While its modules load, and when it has ended, there is nothing to say.
    """
    heeded = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if heeded:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from cmsreduce.cli.commands import main

    try:
        if heeded:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        main()
    finally:
        if heeded:
            signal.signal(signal.SIGINT, signal.SIG_DFL)


if __name__ == "__main__":
    start()
