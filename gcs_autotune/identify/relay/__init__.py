"""Self-oscillation: the limit cycle of a relay experiment and what its first harmonic tells (IS-O, thesis ch. 5-7).

==================  ===========================================================================
limit_cycle         the cycle of a relay experiment, and a monitor that says when to stop it
cycle_reading       limit cycles read off a record
describing_function the relay's first harmonic
iso, matrix_iso     identification for one degree of freedom and for any linear process
decision            linear or nonlinear drag from two limit cycles
==================  ===========================================================================
"""
