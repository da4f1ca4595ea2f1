"""Compare published numbers of ``../shared/data/published_tables.json`` with ours.

Run: ``python3 -m benchmarks.published [--tables FILE] [--only NAME ...]``. There is one module per kind of table;
``sections`` lists them. Ours are computed from printed inputs where possible. All others come from the simulator of the
tests, which shares no code with the package, and are marked so.
"""
