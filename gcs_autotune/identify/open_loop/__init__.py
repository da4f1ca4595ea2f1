"""Methods that read a model off open-loop manoeuvres: ``step`` and ``zig-zag``.

================  =================================================================================
readings          numbers with standard errors, by local polynomials; where an input stands still
ship_log          a run as a ship's log, and its helm orders
steps             readings of every step of the input
step_table        Miskovic2010, table 4.1, and whether the steps tell one story
by_steps          the method ``step``
zigzag_integrals  (4.51)-(4.53) between the instants of a zig-zag
by_zigzag         the method ``zig-zag``: K and T
answer            what both return
================  =================================================================================
"""
