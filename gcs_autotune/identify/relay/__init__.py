"""Self-oscillation: limit cycles of a relay and what their first harmonic tells (IS-O, Miskovic2010, ch. 5-7).

``limit_cycle`` reads cycles off a record and says when to stop an experiment; ``iso`` makes one degree of freedom from
a cycle and decides its drag from two; ``linear_process`` any linear process, and the closed heading loop, from several.
"""
