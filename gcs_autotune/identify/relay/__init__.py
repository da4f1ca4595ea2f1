"""Self-oscillation: the limit cycle of a relay experiment and what its first harmonic tells (IS-O, Miskovic2010, ch.
5-7).

==================  ===========================================================================
limit_cycle         the cycle of a relay experiment, and a monitor that says when to stop it
cycle_reading       limit cycles read off a record: position, or integrated velocity (6.48)
describing_function the relay's first harmonic, that of quadratic drag, integrators and delay
iso                 one degree of freedom from one limit cycle (Table 6.3)
matrix_iso          any linear process (n, m), Type k, delay, from several cycles (6.16)-(6.19)
heading_loop        the closed heading loop from two cycles (6.52), made simpler (Algorithm 8.7)
decision            linear or nonlinear drag from two limit cycles
laser               distance to a surface from two laser dots (3.7)-(3.9)
==================  ===========================================================================

The exact counterpart of ``matrix_iso``, from harmonics instead of describing functions, is
:func:`gcs_autotune.identify.frequency.loop_process`.
"""
