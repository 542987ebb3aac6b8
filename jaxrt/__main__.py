"""`python -m jaxrt`."""

import sys

from jaxrt.cli import main

sys.exit(main())
