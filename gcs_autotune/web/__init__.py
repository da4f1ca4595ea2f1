"""The web page: a live view with a STOP (``gcs-autotune serve``; extra ``web``).

* ``server`` opens the port, prints the link and shuts down in order. ``app`` has the routes, ``access`` authorises
  requests, and ``crowd`` limits idle connections.
* ``job`` is a command in a separate process, controlled by its ``--remote`` lines. ``live`` has its state and the
  viewers. ``orders`` builds its command line from the page's form.
* ``archive`` provides the files on disk, and ``desk`` the calculations on them. ``static`` contains the page, written
  by hand, with uPlot (MIT) as the only library.

The package imports tables (axes, limits, manoeuvres) but nothing that flies or computes. These run in another process,
which neither waits for a viewer nor ends with one.
"""

from __future__ import annotations

from gcs_autotune.web.access import Access
from gcs_autotune.web.app import make_app
from gcs_autotune.web.job import CommandLine
from gcs_autotune.web.server import ServeSettings, serve

__all__ = ["Access", "CommandLine", "ServeSettings", "make_app", "serve"]
