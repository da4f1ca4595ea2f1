"""The page: a live view with a STOP, for whoever is at the waterside (``gcs-autotune serve``; extra ``web``).

* ``server`` opens the port, says the link, and ends in order; ``app`` has the routes; ``access`` says who may.
* ``job`` is one command of ours in a process of its own, steered by its ``--remote`` lines; ``live`` is what is known
  of it, and whoever looks; ``orders`` makes its command line from what was chosen on the page.
* ``archive`` is what is on disk, ``desk`` what is done with it. ``static`` is the page, by hand, with uPlot
  (MIT) and nothing else.

It imports tables (axes, limits, manoeuvres) and nothing that flies or computes: what does is another process, which
neither waits for a viewer nor ends with one.
"""

from __future__ import annotations

from gcs_autotune.web.access import Access
from gcs_autotune.web.app import make_app
from gcs_autotune.web.job import CommandLine
from gcs_autotune.web.server import ServeSettings, serve

__all__ = ["Access", "CommandLine", "ServeSettings", "make_app", "serve"]
