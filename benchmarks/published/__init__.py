"""Every published number of ``../shared/data/published_tables.json`` beside ours.

Run: ``python3 -m benchmarks.published [--tables FILE] [--only NAME ...]``. One small file per kind of table;
``sections`` lists them. What can be computed from printed inputs is; the rest is simulated in the tests' own water,
which shares nothing with the code under test, and says so.
"""
