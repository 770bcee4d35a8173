"""`python -m spherekit` is the command `spherekit`."""

import sys

from spherekit.cli.main import main

sys.exit(main())
