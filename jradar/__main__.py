"""`python -m jradar` runs the command `jradar`."""

import sys

from jradar.cli import main

sys.exit(main())
