"""``python -m ematwin``: the command line."""

from ematwin.cli import main

if __name__ == "__main__":
    main()
