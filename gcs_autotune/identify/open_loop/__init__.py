"""The methods ``step`` and ``zig-zag``, which read a model off open-loop manoeuvres.

================  =================================================================================
readings          values with standard errors, from local polynomials; intervals of constant input
ship_log          heading and rudder of a run, and its helm orders
steps             readings from every step of the input
step_table        Miskovic2010, table 4.1, and whether all steps agree
by_steps          the method ``step``
zigzag_integrals  equations (4.51)-(4.53), integrated between instants of a zig-zag
by_zigzag         the method ``zig-zag``: K and T
answer            the fit that both methods return
================  =================================================================================
"""
