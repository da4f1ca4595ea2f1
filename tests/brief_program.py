"""Our command line, but with designs of few evaluations: ``python tests/brief_program.py ARGUMENTS``.

For tests that fly whole jobs in separate processes; the design worker is one too.
"""

from __future__ import annotations

import sys
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))
    from gcs_autotune import executor
    from gcs_autotune.cli import main
    from tests.conftest import in_few_evaluations, serve_in_few_evaluations

    executor._serve_apart = serve_in_few_evaluations
    with in_few_evaluations():
        sys.exit(main(sys.argv[1:]))
