"""Our command line on a machine whose disk is full once the first step is flown: no file grows any more."""

from __future__ import annotations

import resource
import sys

from gcs_autotune.cli import main, remote
from gcs_autotune.observer import Progress


class Observer(remote.RemoteObserver):
    def update(self, progress: Progress) -> None:
        if progress.stage.startswith("step"):
            resource.setrlimit(resource.RLIMIT_FSIZE, (0, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
        super().update(progress)


if __name__ == "__main__":
    remote.RemoteObserver = Observer  # type: ignore[misc]
    sys.exit(main(sys.argv[1:]))
