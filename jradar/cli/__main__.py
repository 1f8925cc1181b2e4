"""`python -m jradar.cli` is `jradar`."""

import sys

from jradar.cli import main

sys.exit(main())
