"""Studies: thousands of tunes, flights, fits or diagnoses over ranges of numbers, on one computer or a Dask cluster.

==============  ==========================================================================
plan            the study file (TOML) and its cases
jobs            what is done with a case: commands, or a Python function
command_server  runs the commands of a worker, each in a process of its own
craft           the simulated vehicle of a case
build           which code runs, so that all rows come from the same code
store           the results folder: Parquet parts
run             does the cases that are missing, on any executor
figures         rates, intervals, maps and comparisons for the report
cluster         a Dask cluster: local processes, or an existing scheduler
==============  ==========================================================================
"""

from __future__ import annotations

from gcs_autotune.study.cluster import cluster_of
from gcs_autotune.study.figures import StudyProgress, case_study_of, plan_of, progress_of, success_map
from gcs_autotune.study.jobs import commands_of
from gcs_autotune.study.plan import Case, Plan, load_plan
from gcs_autotune.study.run import Started, check_plan, given_up, other_code, play, run_study, unsuited
from gcs_autotune.study.store import Row, Store, open_study

__all__ = [
    "Case",
    "Plan",
    "Row",
    "Started",
    "Store",
    "StudyProgress",
    "case_study_of",
    "check_plan",
    "cluster_of",
    "commands_of",
    "given_up",
    "load_plan",
    "open_study",
    "other_code",
    "plan_of",
    "play",
    "progress_of",
    "run_study",
    "success_map",
    "unsuited",
]
