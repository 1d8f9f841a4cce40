"""`python -m tactile_skin` is the command `tactile-skin`."""

import sys

from .cli import main

if __name__ == "__main__":
    sys.exit(main())
