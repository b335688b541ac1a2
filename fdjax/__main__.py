"""`python -m fdjax` is the command line."""

import sys

from fdjax.app.cli import main

sys.exit(main())
