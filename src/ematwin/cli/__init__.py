"""The command line: thin. Each command reads its options, calls the library, prints the answer."""

import atexit
import gc
import os
import sys


def main() -> None:
    """Entry point of the command ``ematwin``."""
    # numpy reads it when it is loaded: matrices are small here, and threads that wait for one
    # another over them took more than half of the time of an identification
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # pydantic looks through all that is installed for plugins of its own; none is of use here
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    # packages make two hundred thousand objects that live until the end; looking through them for
    # cycles, again and again and once more at exit, took a fifth of an identification
    gc.set_threshold(200_000)
    atexit.register(gc.freeze)
    _open_streams()
    try:
        # here, so that Ctrl-C is answered from the first moment
        from ematwin.cli.app import run
        from ematwin.estimation.interrupt import noting_interrupts

        with noting_interrupts() as interrupts:
            code = run()
        if interrupts.pressed:  # also where what was done until then is the answer
            code = 130
    except KeyboardInterrupt:
        code = 130
    if code == 130:
        print("Interrupted; nothing was left half-written.", file=sys.stderr)
    sys.exit(code)


def _open_streams() -> None:
    """Answer into nothing where a stream was closed, and without what its encoding lacks."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115 (until the end)
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
