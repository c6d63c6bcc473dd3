"""The command line as `python -m tactuator`."""

import sys

from tactuator.cli import main

sys.exit(main())
