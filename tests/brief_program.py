"""Our command line as it is, but for designs of few evaluations: ``python tests/brief_program.py ARGUMENTS``.

For tests that fly whole jobs in processes of their own, and the worker that designs is one too.
"""

from __future__ import annotations

import sys
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))
    from gcs_autotune.cli import main
    from gcs_autotune.workflow import worker
    from tests.conftest import in_few_evaluations

    worker._COMMAND = "import tests.conftest as c; w = c.in_few_evaluations(); w.__enter__(); " + worker._COMMAND
    with in_few_evaluations():
        sys.exit(main(sys.argv[1:]))
