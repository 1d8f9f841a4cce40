"""The command `tactile-skin`, and `python -m tactile_skin`.

It loads for a second. Until then Ctrl-C ends the process at once, as the system does by default: as
an exception it would come out of whatever import it interrupts, as a traceback.
"""

import signal
import sys


def main() -> int:
    """Run one command; returns the exit status."""
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:  # else it is ignored: a shell's background job
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from . import cli

    signal.signal(signal.SIGINT, before)
    return cli.main()


if __name__ == "__main__":
    sys.exit(main())
