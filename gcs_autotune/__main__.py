"""Entry point of ``python -m gcs_autotune``."""

import sys

from gcs_autotune.cli import main

sys.exit(main())
